# Compiler settings, and gsv_add_layer().

set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()
# From CMake 3.19 on: a static library does not wait for the libraries that it is linked with later.
set(CMAKE_OPTIMIZE_DEPENDENCIES ON)
# Vectorise loops over pixels, also those with a square root. The results do not change: nothing here
# reads errno after a mathematical function or traps floating-point exceptions.
add_compile_options($<$<NOT:$<CONFIG:Debug>>:-O3> -fno-math-errno -fno-trapping-math)
# gcc collects garbage less often: a tenth of the time for at most 100 MB more memory.
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  add_compile_options(--param=ggc-min-heapsize=500000)  # [kB]
endif()
# Executables too, so that they share the libraries' precompiled headers.
add_compile_options(-fPIC)
# The imported targets link more libraries than the code uses (all of OpenCV, VTK).
add_link_options(-Wl,--as-needed)
# binutils has two linkers; this one needs a tenth of the time for each of the fifty programs.
find_program(GOLD_LINKER ld.gold)
mark_as_advanced(GOLD_LINKER)
if(GOLD_LINKER AND NOT CMAKE_CROSSCOMPILING)
  add_link_options(-fuse-ld=gold)
endif()

# Use ccache if it is installed and the user has chosen no other launcher.
find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Precompiled headers need the sloppiness, see ccache(1). The base directory lets build folders and
  # clones share the cache.
  set(ccache_settings CCACHE_SLOPPINESS=pch_defines,time_macros)
  if(NOT DEFINED ENV{CCACHE_BASEDIR})
    list(APPEND ccache_settings CCACHE_BASEDIR=${PROJECT_SOURCE_DIR})
  endif()
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env ${ccache_settings} ${CCACHE_PROGRAM})
endif()

if(GROUND_SCALE_VO_SANITIZE)
  set(sanitizers ${GROUND_SCALE_VO_SANITIZE})
  if(sanitizers MATCHES undefined)
    string(APPEND sanitizers ",float-cast-overflow")  # not part of `undefined`
  endif()
  # Without the checks null, object-size and alignment of every memory access: with them compilation
  # takes five times as long, and `address` checks memory accesses as well.
  add_compile_options(-O1 -g1 -fno-omit-frame-pointer -fsanitize=${sanitizers}
    -fno-sanitize=null,object-size,alignment)
  link_libraries(-fsanitize=${sanitizers})
  # Otherwise Eigen allocates with its own function under `address`, and PCL, which is built without
  # the sanitizer, frees that memory with free().
  add_compile_definitions(EIGEN_MALLOC_ALREADY_ALIGNED=1)
endif()

if(GROUND_SCALE_VO_COVERAGE)
  add_compile_options(-fprofile-arcs -ftest-coverage -fprofile-update=atomic)
  link_libraries(--coverage)
endif()

add_library(${PROJECT_NAME}_warnings INTERFACE)
target_compile_options(${PROJECT_NAME}_warnings INTERFACE -Wall -Wextra -Wshadow -Wconversion)

# gsv_add_headers(NAME LIBRARY...): precompiles headers for the targets that name it with
# target_precompile_headers(... REUSE_FROM NAME) and have the same compile options. The headers are
# those of Eigen, OpenCV and the standard library that most files include.
function(gsv_add_headers name)
  add_library(${name} OBJECT ${PROJECT_SOURCE_DIR}/cmake/empty.cpp)
  target_link_libraries(${name} PRIVATE ${ARGN})
  target_precompile_headers(${name} PRIVATE
    <Eigen/Dense> <algorithm> <cmath> <filesystem> <functional> <map> <memory> <opencv2/core.hpp>
    <opencv2/imgproc.hpp> <optional> <string> <vector>)
endfunction()
# gsv_add_ros_headers(NAME LIBRARY...): like gsv_add_headers(), with the headers of ROS.
function(gsv_add_ros_headers name)
  gsv_add_headers(${name} ${ARGN})
  target_include_directories(${name} SYSTEM PRIVATE ${catkin_INCLUDE_DIRS})
  target_precompile_headers(${name} PRIVATE
    <ros/ros.h> <nav_msgs/Odometry.h> <sensor_msgs/CameraInfo.h> <sensor_msgs/Image.h>)
endfunction()

# gsv_add_layer(NAME SHARED|STATIC MODULE...): adds the library ${PROJECT_NAME}_NAME with all sources
# of the modules: src/MODULE/*.cpp or src/MODULE.cpp; in another folder than the root, MODULE/*.cpp.
function(gsv_add_layer name type)
  set(sources)
  set(folder ${CMAKE_CURRENT_SOURCE_DIR})
  if(folder STREQUAL PROJECT_SOURCE_DIR)
    set(folder ${PROJECT_SOURCE_DIR}/src)
  endif()
  foreach(module ${ARGN})
    file(GLOB module_sources CONFIGURE_DEPENDS ${folder}/${module}/*.cpp ${folder}/${module}.cpp)
    list(APPEND sources ${module_sources})
  endforeach()
  if(name STREQUAL simulation AND GROUND_SCALE_VO_SANITIZE)
    # Do not instrument the renderer: it takes most of the tests' time, and its threads only read the
    # scene, which is constant after construction.
    set(renderer ${sources})
    list(FILTER renderer INCLUDE REGEX "/(renderer|world)/[a-z_]+\\.cpp$|/synthetic_drive\\.cpp$")
    set_source_files_properties(${renderer} PROPERTIES COMPILE_OPTIONS "-fno-sanitize=all;-O3")
  endif()
  if(GROUND_SCALE_VO_SANITIZE STREQUAL thread)
    # Nor the loops over pixels, which take most of the rest: they read an image and write to a buffer
    # of the caller, and share nothing.
    set(loops ${sources})
    list(FILTER loops INCLUDE REGEX
      "/(corner_detection|lucas_kanade|patch_matcher)\\.cpp$")
    set_source_files_properties(${loops} PROPERTIES COMPILE_OPTIONS "-fno-sanitize=all;-O3")
  endif()
  if(name STREQUAL simulation AND GROUND_SCALE_VO_COVERAGE)
    # Not of the product, and counting makes the renderer several times slower.
    set_source_files_properties(${sources} PROPERTIES
      COMPILE_OPTIONS "-fno-profile-arcs;-fno-test-coverage")
  endif()
  set(target ${PROJECT_NAME}_${name})
  add_library(${target} ${type} ${sources})
  if(NOT DEFINED CMAKE_UNITY_BUILD)
    # Seven files compiled as one take two thirds of the time or less. A change of one file
    # recompiles all seven, so set -DCMAKE_UNITY_BUILD=OFF while you edit.
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 7)
  endif()
  # No macro <target>_EXPORTS: the precompiled headers are compiled without it.
  set_target_properties(${target} PROPERTIES DEFINE_SYMBOL "")
  target_include_directories(${target}
    PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    PRIVATE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>)
  target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:${PROJECT_NAME}_warnings>)
  if(name MATCHES "nodelets|ros_tools")
    target_precompile_headers(${target} REUSE_FROM ${PROJECT_NAME}_ros_headers)
  else()
    target_precompile_headers(${target} REUSE_FROM ${PROJECT_NAME}_headers)
  endif()
endfunction()
