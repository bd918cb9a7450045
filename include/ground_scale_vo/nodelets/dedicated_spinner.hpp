#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

#include <boost/make_shared.hpp>
#include <functional>
#include <utility>

namespace ground_scale_vo {

/// Runs the callbacks of one nodelet, one after the other, on a thread of its own.
///
/// The nodelet manager's queue is not used for three reasons: it drops what arrives during onInit
/// (such as a latched camera_info), it is destroyed before the subscriptions when onInit throws,
/// and it shares its threads with the other nodelets.
///
/// Declare it as the first member of a nodelet, so that it is destroyed after all members that use
/// its handles.
class DedicatedSpinner {
 public:
  /// A copy of the handle whose callbacks go to this queue.
  ros::NodeHandle handle(ros::NodeHandle of_nodelet) {
    of_nodelet.setCallbackQueue(&queue_);
    return of_nodelet;
  }
  /// Callbacks run from now on.
  void start() { spinner_.start(); }
  /// Waits for the callback in progress; no callback runs afterwards.
  void stop() { spinner_.stop(); }

  /// Runs the task on the same thread, after all callbacks that wait now.
  void post(std::function<void()> task) {
    queue_.addCallback(boost::make_shared<Task>(std::move(task)));
  }

 private:
  class Task : public ros::CallbackInterface {
   public:
    explicit Task(std::function<void()> task) : task_(std::move(task)) {}
    CallResult call() override {
      task_();
      return Success;
    }

   private:
    const std::function<void()> task_;
  };

  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_{1, &queue_};
};

}  // namespace ground_scale_vo
