# The package without ROS: find_package(ground_scale_vo), target ground_scale_vo::core.

include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/${PROJECT_NAME})
configure_package_config_file(
  ${PROJECT_SOURCE_DIR}/cmake/package-config.cmake.in ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config.cmake
  INSTALL_DESTINATION ${package_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config.cmake
  ${PROJECT_BINARY_DIR}/${PROJECT_NAME}-config-version.cmake DESTINATION ${package_folder})

# gsv_install_layer(NAME): the library as ${PROJECT_NAME}::NAME, with the headers of its modules.
function(gsv_install_layer name)
  set(target ${PROJECT_NAME}_${name})
  add_library(${PROJECT_NAME}::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(${target} PUBLIC $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  install(TARGETS ${target} EXPORT ${PROJECT_NAME}-targets
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT ${PROJECT_NAME}-targets NAMESPACE ${PROJECT_NAME}::
    DESTINATION ${package_folder})
endfunction()

# gsv_install_tools(TARGET...)
function(gsv_install_tools)
  install(TARGETS ${ARGN} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endfunction()

install(DIRECTORY include/${PROJECT_NAME}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${PROJECT_NAME}
  PATTERN io EXCLUDE
  PATTERN evaluation EXCLUDE
  PATTERN calibration EXCLUDE
  PATTERN simulation EXCLUDE
  PATTERN ros EXCLUDE
  PATTERN nodelets EXCLUDE
  PATTERN ros_tools EXCLUDE)
