# Unit, fuzz and node tests.

# gsv_as_test(TARGET HEADERS): include folders, libraries and compile options of a test. HEADERS: the
# target that precompiles its headers. The tests are compiled at -O1: most of their run time is spent
# in the libraries.
function(gsv_as_test target headers)
  target_include_directories(${target} PRIVATE
    ${PROJECT_SOURCE_DIR}/test ${PROJECT_SOURCE_DIR}/src)
  target_compile_options(${target} PRIVATE $<$<NOT:$<CONFIG:Debug>>:-O1>)
  target_link_libraries(${target} ${OpenCV_LIBS} ${PROJECT_NAME}_warnings)
  target_precompile_headers(${target} REUSE_FROM ${headers})
  if(NOT DEFINED CMAKE_UNITY_BUILD)
    # All files of a test as one: most of the time goes into templates that they share.
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
  endif()
endfunction()
set(gtest_targets)
if(TARGET GTest::gtest)
  set(gtest_targets GTest::gtest)
endif()
gsv_add_headers(gsv_test_headers Eigen3::Eigen opencv_core ${gtest_targets})
target_precompile_headers(gsv_test_headers PRIVATE <gtest/gtest.h>)
target_compile_options(gsv_test_headers PRIVATE $<$<NOT:$<CONFIG:Debug>>:-O1>)
if(GROUND_SCALE_VO_ROS)
  gsv_add_ros_headers(gsv_ros_test_headers Eigen3::Eigen opencv_core ${gtest_targets})
  target_precompile_headers(gsv_ros_test_headers PRIVATE <gtest/gtest.h>)
  target_compile_options(gsv_ros_test_headers PRIVATE $<$<NOT:$<CONFIG:Debug>>:-O1>)
endif()

# The rostests: one executable, which each NAME_rostest.test starts for the tests of NAME_rostest.cpp.
# One of the two starts the nodes under test. Added first: it takes longest to compile.
if(GROUND_SCALE_VO_ROS)
  find_package(rostest REQUIRED)
  file(GLOB ROSTESTS CONFIGURE_DEPENDS test/rostest/*_rostest.cpp)
  catkin_add_executable_with_gtest(rostests test/rostest/main.cpp ${ROSTESTS} EXCLUDE_FROM_ALL)
  target_link_libraries(rostests ${PROJECT_NAME}_ros_tools ${PROJECT_NAME}_simulation gtest)
  gsv_as_test(rostests gsv_ros_test_headers)
  set_target_properties(rostests PROPERTIES UNITY_BUILD_BATCH_SIZE 6)  # compiled on two cores
  add_dependencies(tests rostests)
  foreach(source ${ROSTESTS})
    get_filename_component(test ${source} NAME_WE)
    add_rostest(test/rostest/${test}.test DEPENDENCIES rostests)
  endforeach()
  foreach(test graph long_run images)  # the longest start first
    set_tests_properties(
      _ctest_${PROJECT_NAME}_rostest_test_rostest_${test}_rostest.test PROPERTIES COST 1000)
  endforeach()
endif()

# gsv_add_unit_tests(MODULE LIBRARY...): adds a test of test/MODULE/*_test.cpp.
function(gsv_add_unit_tests module)
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/test/${module}/*_test.cpp)
  if(sources)
    gsv_add_unit_test(${module}_test "${sources}" ${ARGN})
  endif()
endfunction()
function(gsv_add_unit_test target sources)
  gsv_add_gtest(${target} ${sources})
  target_link_libraries(${target} ${ARGN} gtest_main)
  if(target STREQUAL "ros_test")
    gsv_as_test(${target} gsv_ros_test_headers)
  else()
    gsv_as_test(${target} gsv_test_headers)
  endif()
endfunction()

gsv_add_unit_tests(vo ${PROJECT_NAME}_simulation opencv_video)
foreach(module common input lens)
  gsv_add_unit_tests(${module} ${PROJECT_NAME}_core)
endforeach()
foreach(module scale io evaluation simulation integration)
  gsv_add_unit_tests(${module} ${PROJECT_NAME}_simulation)
endforeach()
# These take longest: two tests, which can run at the same time.
foreach(drives fault_drives scenarios)
  gsv_add_unit_test(${drives}_test test/drives/${drives}_test.cpp ${PROJECT_NAME}_simulation)
endforeach()
if(GROUND_SCALE_VO_ROS)
  gsv_add_unit_tests(ros
    ${PROJECT_NAME}_nodelets ${PROJECT_NAME}_ros_tools ${PROJECT_NAME}_simulation)
endif()
# The longest tests start first, in parallel with each other, then the others.
foreach(long_test fault_drives scenarios integration vo)
  set(test _ctest_${PROJECT_NAME}_gtest_${long_test}_test)
  if(TEST ${test})
    set_tests_properties(${test} PROPERTIES COST 1000)
  endif()
endforeach()

# Fuzz targets: files and options, and the messages of each nodelet. A driver in
# test/fuzz mutates valid inputs from a fixed seed.
function(gsv_add_fuzz_target target headers)
  gsv_add_gtest(${target} test/fuzz/${target}.cpp test/fuzz/fuzz_driver.cpp)
  target_link_libraries(${target} ${PROJECT_NAME}_simulation ${ARGN})
  gsv_as_test(${target} ${headers})
endfunction()
gsv_add_fuzz_target(files_fuzz gsv_test_headers)
if(GROUND_SCALE_VO_ROS)
  foreach(target mono_vo_fuzz scale_recovery_fuzz)
    gsv_add_fuzz_target(${target} gsv_ros_test_headers ${PROJECT_NAME}_nodelets)
  endforeach()
endif()

# Tests that do more, or something else, with GROUND_SCALE_VO_LONG: scripts/test --long.
foreach(test fault_drives_test scenarios_test
    files_fuzz mono_vo_fuzz scale_recovery_fuzz)
  if(TEST _ctest_${PROJECT_NAME}_gtest_${test})
    set_tests_properties(_ctest_${PROJECT_NAME}_gtest_${test} PROPERTIES LABELS long)
  endif()
endforeach()
if(GROUND_SCALE_VO_ROS)
  foreach(test shutdown long_run)
    set_tests_properties(
      _ctest_${PROJECT_NAME}_rostest_test_rostest_${test}_rostest.test PROPERTIES LABELS long)
  endforeach()
endif()
