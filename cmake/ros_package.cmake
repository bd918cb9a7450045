# The catkin package: messages, exports, and install rules.

# Debian bullseye: catkin remembers gmock, but not its targets, when CMake runs a second time.
unset(GMOCK_FOUND CACHE)
find_package(catkin REQUIRED COMPONENTS
  diagnostic_msgs
  diagnostic_updater
  geometry_msgs
  image_transport
  message_generation
  nav_msgs
  nodelet
  pluginlib
  rosbag
  roscpp
  sensor_msgs
  std_msgs
  std_srvs
  tf2
  tf2_eigen
  tf2_msgs
  tf2_ros
  topic_tools
  visualization_msgs
)

add_message_files(FILES ScaleEstimate.msg VoFrame.msg)
# Where genpy would write an empty file: also a shell with this workspace finds the Python module.
configure_file(python/${PROJECT_NAME}/__init__.py
  ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION}/${PROJECT_NAME}/__init__.py COPYONLY)
generate_messages(DEPENDENCIES geometry_msgs std_msgs)

catkin_package(
  INCLUDE_DIRS include
  LIBRARIES ${PROJECT_NAME}_core ${PROJECT_NAME}_nodelets
  CATKIN_DEPENDS
    diagnostic_msgs diagnostic_updater geometry_msgs image_transport
    message_runtime nav_msgs nodelet pluginlib roscpp sensor_msgs std_msgs std_srvs tf2
    tf2_eigen tf2_msgs tf2_ros topic_tools visualization_msgs
  DEPENDS EIGEN3 OpenCV
)

set(GROUND_SCALE_VO_INSTALLED_HEADERS ${CATKIN_PACKAGE_INCLUDE_DESTINATION})
# Install the tools where rosrun searches for executables.
set(GROUND_SCALE_VO_BUILT_TOOLS ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_BIN_DESTINATION})
set(GROUND_SCALE_VO_INSTALLED_TOOLS ${CATKIN_PACKAGE_BIN_DESTINATION})

# gsv_install_layer(NAME): installs the library of module group NAME (core or nodelets).
function(gsv_install_layer name)
  install(TARGETS ${PROJECT_NAME}_${name}
    ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    RUNTIME DESTINATION ${CATKIN_GLOBAL_BIN_DESTINATION})
endfunction()

set(GROUND_SCALE_VO_TESTS ${CATKIN_ENABLE_TESTING})

# gsv_add_gtest(TARGET SOURCE...): adds a unit test; built by target `tests`, run by ctest.
function(gsv_add_gtest target)
  catkin_add_gtest(${target} ${ARGN})
  target_link_libraries(${target} gtest)
endfunction()

catkin_install_python(PROGRAMS nodes/bag_recorder nodes/feed_another_vo nodes/playback_monitor nodes/view_frame
  scripts/metrics_table.py scripts/plot_run.py scripts/presets.py scripts/run_page.py
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(DIRECTORY config launch rviz DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
# The scripts expect the executables in the same directory after installation.
install(PROGRAMS scripts/benchmark scripts/calibrate_camera scripts/calibrate_height scripts/compare scripts/demo
  scripts/evaluate scripts/package scripts/report
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(DIRECTORY scripts/lib DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES config/presets.yaml scripts/run_page.html DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES nodelet_plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})

# CPack settings used by scripts/package; the script adds the dependencies that are not shared
# libraries.
if(CMAKE_SOURCE_DIR STREQUAL PROJECT_SOURCE_DIR)
  set(CPACK_GENERATOR DEB)
  set(CPACK_PACKAGE_NAME ground-scale-vo)
  set(CPACK_PACKAGE_VERSION ${${PROJECT_NAME}_VERSION})
  set(CPACK_PACKAGE_CONTACT "${${PROJECT_NAME}_MAINTAINER}")
  set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "metric monocular visual odometry for ROS")
  set(CPACK_STRIP_FILES ON)
  set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
  set(CPACK_DEBIAN_PACKAGE_SECTION science)
  set(CPACK_DEBIAN_PACKAGE_RECOMMENDS rviz)
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
  # Lets dpkg-shlibdeps find this project's libraries, which no installed package provides.
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS
    ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_LIB_DESTINATION})
  include(CPack)
  install(FILES LICENSE DESTINATION share/doc/${CPACK_PACKAGE_NAME} RENAME copyright)
endif()
