#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

namespace ground_scale_vo {

/// The callbacks of one nodelet, one after the other on a thread of its own.
///
/// Not the manager's queue: that throws away what arrives during onInit (a latched camera_info, or
/// an image whose place in the queue is then missing for ever), is gone when the subscriptions of
/// an onInit that threw are, and shares its threads with the other nodelets.
///
/// To be a nodelet's first member, so that it outlives all that was made with its handles.
class DedicatedSpinner {
 public:
  /// The same handle, with its callbacks here.
  ros::NodeHandle handle(ros::NodeHandle of_nodelet) {
    of_nodelet.setCallbackQueue(&queue_);
    return of_nodelet;
  }
  /// From now on callbacks run.
  void start() { spinner_.start(); }
  /// After this none runs any more.
  void stop() { spinner_.stop(); }

 private:
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_{1, &queue_};
};

}  // namespace ground_scale_vo
