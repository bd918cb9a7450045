#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// First in, first out, of bounded length: a full queue drops its oldest item. Not thread safe.
template <typename Item>
class BoundedQueue {
 public:
  /// Precondition: capacity > 0.
  explicit BoundedQueue(std::size_t capacity) : capacity_(capacity) {}

  /// False if the oldest item was dropped to make room.
  bool push(Item item) {
    const bool full = items_.size() == capacity_;
    if (full) items_.pop_front();
    items_.push_back(std::move(item));
    return !full;
  }

  /// The oldest item.
  std::optional<Item> pop() {
    if (items_.empty()) return std::nullopt;
    std::optional<Item> item(std::move(items_.front()));
    items_.pop_front();
    return item;
  }

  bool empty() const { return items_.empty(); }

 private:
  const std::size_t capacity_;
  std::deque<Item> items_;
};

}  // namespace ground_scale_vo
