# The Python extension module, built and installed by setup.py: ground_scale_vo._core.

if(Python3_FOUND)
  # catkin has looked for the interpreter only, and pybind11 then looks no further.
  find_package(Python3 REQUIRED COMPONENTS Interpreter Development)
endif()
find_package(pybind11 REQUIRED)
pybind11_add_module(${PROJECT_NAME}_python MODULE NO_EXTRAS python/module.cpp)
target_link_libraries(${PROJECT_NAME}_python PRIVATE
  ${PROJECT_NAME}_evaluation $<BUILD_INTERFACE:${PROJECT_NAME}_warnings>)
# The Python package contains the module and, beside it, the library of the core.
set_target_properties(${PROJECT_NAME}_python PROPERTIES OUTPUT_NAME _core INSTALL_RPATH "$ORIGIN")
install(TARGETS ${PROJECT_NAME}_core ${PROJECT_NAME}_python LIBRARY DESTINATION .
  COMPONENT python EXCLUDE_FROM_ALL)
install(FILES scripts/plot_run.py DESTINATION . COMPONENT python EXCLUDE_FROM_ALL)
