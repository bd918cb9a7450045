// Carries a precompiled header, see tests.cmake.
