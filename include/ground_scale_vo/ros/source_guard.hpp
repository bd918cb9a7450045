#pragma once

#include <functional>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// Detects that two sources publish on one topic, such as two cameras: the description of the
/// source in the messages changes, changes back, and changes again. A single change is a source
/// with new settings, a change that is undone may be one invalid message.
template <typename Source>
class SourceGuard {
 public:
  enum class Verdict {
    kSame,     ///< of the source in use
    kChanged,  ///< of another source, which is in use from now on
    kOther     ///< of another source, while two alternate: drop the message
  };
  using IsSame = std::function<bool(const Source&, const Source&)>;

  /// [messages] After this many of one source in a row, the other one is forgotten.
  static constexpr int kMemory = 100;

  explicit SourceGuard(IsSame is_same = std::equal_to<Source>()) : is_same_(std::move(is_same)) {}

  Verdict check(const Source& source) {
    if (!current_) {
      current_ = source;
      return Verdict::kChanged;
    }
    const bool is_current = is_same_(*current_, source);
    run_ = is_current == last_is_current_ ? run_ + 1 : 1;
    last_is_current_ = is_current;
    if (is_current) {
      if (run_ >= kMemory) forget();
      return Verdict::kSame;
    }
    if (alternates_ && run_ < kMemory) return Verdict::kOther;
    const bool returns = !alternates_ && other_ && is_same_(*other_, source);
    if (returns && has_returned_) {
      alternates_ = true;
      return Verdict::kOther;
    }
    has_returned_ = returns;
    alternates_ = false;
    other_ = std::exchange(*current_, source);
    run_ = 0;
    last_is_current_ = true;
    return Verdict::kChanged;
  }

  /// The source in use. Precondition: check() was called.
  const Source& current() const { return *current_; }
  /// The other one, if two alternate, or the one that was in use before; empty: none or forgotten.
  const std::optional<Source>& other() const { return other_; }
  bool alternates() const { return alternates_; }

 private:
  void forget() {
    other_.reset();
    alternates_ = has_returned_ = false;
  }

  const IsSame is_same_;
  std::optional<Source> current_, other_;
  bool has_returned_ = false;  ///< the last change led back to the source before
  bool alternates_ = false;
  bool last_is_current_ = true;  ///< the last message is of the source in use
  int run_ = 0;                  ///< messages of one source in a row
};

}  // namespace ground_scale_vo
