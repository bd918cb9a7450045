// Carries a precompiled header, see gsv_add_headers() in compiler_settings.cmake.
