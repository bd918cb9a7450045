// Empty source of the object library that builds a precompiled header; see gsv_add_headers() in
// compiler_settings.cmake.
