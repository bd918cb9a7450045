# The Python extension module, built and installed by setup.py: ground_scale_vo._core.

# catkin and VTK have looked for the interpreter only, and pybind11 then looks no further.
foreach(python Python Python3)
  if(${python}_FOUND)
    find_package(${python} REQUIRED COMPONENTS Interpreter Development)
  endif()
endforeach()
find_package(pybind11 REQUIRED)
pybind11_add_module(${PROJECT_NAME}_python MODULE NO_EXTRAS python/module.cpp python/drives.cpp)
target_include_directories(${PROJECT_NAME}_python PRIVATE ${PROJECT_SOURCE_DIR}/src)
target_compile_definitions(${PROJECT_NAME}_python PRIVATE GROUND_SCALE_VO_VERSION="${PROJECT_VERSION}")
target_link_libraries(${PROJECT_NAME}_python PRIVATE
  ${PROJECT_NAME}_evaluation $<BUILD_INTERFACE:${PROJECT_NAME}_warnings>)
# The Python package contains the module and, beside it, the library of the core.
set(python_package python/${PROJECT_NAME})
set(built_package ${GROUND_SCALE_VO_BUILT_TOOLS}/${python_package})
set_target_properties(${PROJECT_NAME}_python PROPERTIES
  OUTPUT_NAME _core LIBRARY_OUTPUT_DIRECTORY ${built_package} INSTALL_RPATH "$ORIGIN;$ORIGIN/../../..")
install(TARGETS ${PROJECT_NAME}_core ${PROJECT_NAME}_python LIBRARY DESTINATION .
  COMPONENT python EXCLUDE_FROM_ALL)
set(shared_files scripts/plot_run.py scripts/run_page.py scripts/run_page.html scripts/presets.py config/presets.yaml)
install(FILES ${shared_files} DESTINATION . COMPONENT python EXCLUDE_FROM_ALL)

# The whole package beside the tools, where scripts/calibrate_camera finds it.
file(GLOB python_files CONFIGURE_DEPENDS ${python_package}/*.py)
foreach(file ${shared_files})
  list(APPEND python_files ${PROJECT_SOURCE_DIR}/${file})
endforeach()
file(MAKE_DIRECTORY ${built_package})
foreach(file ${python_files})
  get_filename_component(name ${file} NAME)
  file(CREATE_LINK ${file} ${built_package}/${name} SYMBOLIC)
endforeach()
if(GROUND_SCALE_VO_ROS)
  install(TARGETS ${PROJECT_NAME}_python
    LIBRARY DESTINATION ${GROUND_SCALE_VO_INSTALLED_TOOLS}/${python_package})
  install(FILES ${python_files} DESTINATION ${GROUND_SCALE_VO_INSTALLED_TOOLS}/${python_package})
endif()
