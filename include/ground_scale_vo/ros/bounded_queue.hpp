#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// Hands items from one thread to another. When it is full the oldest item goes: newest wins.
/// Items wait until release() was called for the first time. Thread safe.
template <typename Item>
class BoundedQueue {
 public:
  /// Precondition: capacity > 0.
  explicit BoundedQueue(std::size_t capacity) : capacity_(capacity) {}

  /// False when an older item had to go for it. After close() nothing is kept.
  bool push(Item item) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (closed_) return true;
    const bool full = items_.size() == capacity_;
    if (full) items_.pop_front();
    items_.push_back(std::move(item));
    changed_.notify_one();
    return !full;
  }

  void release() {
    const std::lock_guard<std::mutex> lock(mutex_);
    released_ = true;
    changed_.notify_one();
  }

  /// Waits for the oldest item; empty when the queue was closed.
  std::optional<Item> pop() {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return closed_ || (released_ && !items_.empty()); });
    if (closed_) return std::nullopt;
    std::optional<Item> item(std::move(items_.front()));
    items_.pop_front();
    return item;
  }

  /// Ends every pop(), now and later; what waits is thrown away.
  void close() {
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
    items_.clear();
    changed_.notify_all();
  }

 private:
  const std::size_t capacity_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> items_;
  bool released_ = false;
  bool closed_ = false;
};

}  // namespace ground_scale_vo
