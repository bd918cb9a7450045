#pragma once

#include <functional>
#include <optional>
#include <utility>

namespace ground_scale_vo {

/// Detects that the description of the source in the messages keeps changing: two sources, such as
/// two cameras, publish on one topic, or one source describes itself differently in every message.
/// A single change is a source with new settings, a change that is undone may be one invalid
/// message; the third change keeps the source in use until kMemory messages in a row agree.
template <typename Source>
class SourceGuard {
 public:
  enum class Verdict {
    kSame,       ///< of the source in use
    kChanged,    ///< of another source, which is in use from now on
    kOther,      ///< of the other one of two sources that alternate: drop the message
    kUnsettled,  ///< of yet another source: the description keeps changing
  };
  using IsSame = std::function<bool(const Source&, const Source&)>;

  /// [messages] After this many of one source in a row, the others are forgotten.
  static constexpr int kMemory = 100;
  /// The source changes for this many times; further changes are not followed.
  static constexpr int kMaxChanges = 2;

  explicit SourceGuard(IsSame is_same = std::equal_to<Source>()) : is_same_(std::move(is_same)) {}

  Verdict check(const Source& source) {
    if (!current_) {
      current_ = source;
      return Verdict::kChanged;
    }
    const bool is_current = is_same_(*current_, source);
    const bool is_other = !is_current && other_ && is_same_(*other_, source);
    run_ = is_current == last_is_current_ && (is_current || is_other) ? run_ + 1 : 1;
    last_is_current_ = is_current;
    if (is_current) {
      if (run_ >= kMemory) forget();
      return Verdict::kSame;
    }
    if (changes_ >= kMaxChanges && run_ < kMemory) {
      unrest_ = is_other ? Verdict::kOther : Verdict::kUnsettled;
      if (!is_other) other_ = source;
      return *unrest_;
    }
    changes_ = unrest_ ? 1 : changes_ + 1;
    unrest_.reset();
    other_ = std::exchange(*current_, source);
    run_ = 0;
    last_is_current_ = true;
    return Verdict::kChanged;
  }

  /// The source in use. Precondition: check() was called.
  const Source& current() const { return *current_; }
  /// The latest one that is not in use; empty: none or forgotten.
  const std::optional<Source>& other() const { return other_; }
  bool alternates() const { return unrest_ == Verdict::kOther; }
  bool keepsChanging() const { return unrest_.has_value(); }  ///< it alternates or is unsettled

 private:
  void forget() {
    other_.reset();
    unrest_.reset();
    changes_ = 0;
  }

  const IsSame is_same_;
  std::optional<Source> current_, other_;
  std::optional<Verdict> unrest_;  ///< kOther or kUnsettled, of the last message not in use
  bool last_is_current_ = true;    ///< the last message is of the source in use
  int run_ = 0;                    ///< messages of one source in a row
  int changes_ = 0;                ///< since the sources were forgotten
};

}  // namespace ground_scale_vo
