# The package without ROS: find_package(ground_scale_vo), target ground_scale_vo::core.

include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(GROUND_SCALE_VO_INSTALLED_HEADERS ${CMAKE_INSTALL_INCLUDEDIR}/${PROJECT_NAME})
# Install the tools in a separate folder beside the libraries, as in a catkin package.
set(GROUND_SCALE_VO_BUILT_TOOLS ${PROJECT_BINARY_DIR}/tools)
set(GROUND_SCALE_VO_INSTALLED_TOOLS ${CMAKE_INSTALL_LIBDIR}/${PROJECT_NAME})
set(GROUND_SCALE_VO_TOOLS_RPATH "$ORIGIN/..")

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/${PROJECT_NAME})
configure_package_config_file(
  ${PROJECT_SOURCE_DIR}/cmake/package-config.cmake.in ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config.cmake
  INSTALL_DESTINATION ${package_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config.cmake
  ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config-version.cmake DESTINATION ${package_folder})

# gsv_install_layer(NAME): installs the library of module group NAME, exported as
# ${PROJECT_NAME}::NAME.
function(gsv_install_layer name)
  set(target ${PROJECT_NAME}_${name})
  add_library(${PROJECT_NAME}::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(${target} PUBLIC cxx_std_17)
  target_include_directories(${target} INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  install(TARGETS ${target} EXPORT ${PROJECT_NAME}-targets
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT ${PROJECT_NAME}-targets NAMESPACE ${PROJECT_NAME}::
    DESTINATION ${package_folder})
endfunction()

# gsv_add_gtest(TARGET SOURCE...): adds a unit test; built by target `all`, run by ctest.
function(gsv_add_gtest target)
  add_executable(${target} ${ARGN})
  target_link_libraries(${target} GTest::gtest)
  add_test(NAME ${target} COMMAND ${target})
endfunction()

option(GROUND_SCALE_VO_TESTS "build the unit tests" OFF)
if(GROUND_SCALE_VO_TESTS)
  enable_testing()
  find_package(GTest REQUIRED)
endif()
