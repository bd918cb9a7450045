# Unit, fuzz and node tests; micro-benchmarks.

# The tests are compiled at -O1: their time goes into the libraries. One precompiled header serves all
# that link the same libraries.
function(gsv_add_test_headers name)
  add_library(${name} OBJECT ${PROJECT_SOURCE_DIR}/cmake/empty.cpp)
  gsv_as_test(${name})
  target_link_libraries(${name} PRIVATE ${ARGN} gtest)  # its definitions too
  target_precompile_headers(${name} PRIVATE
    <gtest/gtest.h> <Eigen/Dense> <algorithm> <cmath> <filesystem> <functional> <map> <memory>
    <opencv2/core.hpp> <opencv2/imgproc.hpp> <optional> <string> <vector>)
endfunction()
function(gsv_as_test target)
  target_include_directories(${target} PRIVATE
    ${PROJECT_SOURCE_DIR}/test ${PROJECT_SOURCE_DIR}/src)
  target_compile_options(${target} PRIVATE $<$<NOT:$<CONFIG:Debug>>:-O1>)
endfunction()
gsv_add_test_headers(gsv_test_headers ${PROJECT_NAME}_simulation ${PROJECT_NAME}_warnings)
gsv_add_test_headers(gsv_ros_test_headers ${PROJECT_NAME}_ros_tools ${PROJECT_NAME}_warnings)
target_precompile_headers(gsv_ros_test_headers PRIVATE
  <ros/ros.h> <nav_msgs/Odometry.h> <sensor_msgs/CameraInfo.h> <sensor_msgs/Image.h>)

# gsv_add_unit_tests(MODULE LIBRARY...): test/MODULE/*_test.cpp.
function(gsv_add_unit_tests module)
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/test/${module}/*_test.cpp)
  if(NOT sources)
    return()
  endif()
  catkin_add_gtest(${module}_test ${sources})
  gsv_as_test(${module}_test)
  target_link_libraries(${module}_test ${ARGN} ${PROJECT_NAME}_warnings gtest_main)
  if(module MATCHES "^ros")
    target_precompile_headers(${module}_test REUSE_FROM gsv_ros_test_headers)
  else()
    target_precompile_headers(${module}_test REUSE_FROM gsv_test_headers)
  endif()
endfunction()

find_package(Ceres REQUIRED)  # an independent solver for the test of the bundle adjustment
gsv_add_unit_tests(common ${PROJECT_NAME}_core)
gsv_add_unit_tests(vo ${PROJECT_NAME}_simulation ${CERES_LIBRARIES})
gsv_add_unit_tests(scale ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(io ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(evaluation ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(calibration ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(simulation ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(integration ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(ros ${PROJECT_NAME}_nodelets ${PROJECT_NAME}_simulation)
gsv_add_unit_tests(ros_tools ${PROJECT_NAME}_ros_tools)

# The fuzz targets, one for each parser and each nodelet's messages. A driver in test/fuzz mutates
# valid inputs from a fixed seed; with GROUND_SCALE_VO_FUZZ and clang++ libFuzzer drives them.
file(GLOB FUZZ_TARGETS CONFIGURE_DEPENDS test/fuzz/*_fuzz.cpp)
foreach(source ${FUZZ_TARGETS})
  get_filename_component(target ${source} NAME_WE)
  if(GROUND_SCALE_VO_FUZZ)
    #catkin_lint: skip
    add_executable(${target} ${source} test/fuzz/fuzz_target.cpp)
    target_link_libraries(${target} -fsanitize=fuzzer)
  else()
    catkin_add_gtest(${target} ${source} test/fuzz/fuzz_target.cpp test/fuzz/fuzz_driver.cpp)
    target_link_libraries(${target} gtest)
  endif()
  gsv_as_test(${target})
  target_link_libraries(${target}
    ${PROJECT_NAME}_nodelets ${PROJECT_NAME}_simulation ${PROJECT_NAME}_warnings)
endforeach()

# The rostests: one executable that a .test file starts beside a nodelet manager.
find_package(rostest REQUIRED)
file(GLOB ROSTESTS CONFIGURE_DEPENDS test/rostest/*_rostest.cpp)
foreach(source ${ROSTESTS})
  get_filename_component(test ${source} NAME_WE)
  add_rostest_gtest(${test} test/rostest/${test}.test ${source})
  gsv_as_test(${test})
  target_link_libraries(${test}
    ${PROJECT_NAME}_ros_tools ${PROJECT_NAME}_simulation ${PROJECT_NAME}_warnings gtest)
  target_precompile_headers(${test} REUSE_FROM gsv_ros_test_headers)
endforeach()

# The micro-benchmarks: `cmake --build build --target benchmarks`.
find_package(benchmark QUIET)
if(benchmark_FOUND)
  #catkin_lint: skip
  file(GLOB BENCHMARK_SOURCES CONFIGURE_DEPENDS benchmark/*_benchmark.cpp)
  add_executable(benchmarks EXCLUDE_FROM_ALL ${BENCHMARK_SOURCES})
  target_include_directories(benchmarks PRIVATE ${PROJECT_SOURCE_DIR}/test)  # their scenes
  set_target_properties(benchmarks PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR})
  target_link_libraries(benchmarks PRIVATE
    ${PROJECT_NAME}_core ${PROJECT_NAME}_warnings benchmark::benchmark_main)
else()
  message(STATUS "Google Benchmark (libbenchmark-dev) is not there: no target benchmarks")
endif()
