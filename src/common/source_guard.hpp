#pragma once

#include <functional>
#include <optional>
#include <utility>

namespace gsv {

/// Detects that the description of the source in the messages keeps changing, as of two cameras on
/// one topic: the third change keeps the source in use until kMemory messages in a row agree.
template <typename Source>
class SourceGuard {
 public:
  using IsSame = std::function<bool(const Source&, const Source&)>;

  /// [messages] After this many of one source in a row, the others are forgotten.
  static constexpr int kMemory = 100;
  /// The source changes for this many times; further changes are not followed.
  static constexpr int kMaxChanges = 2;

  explicit SourceGuard(IsSame is_same = std::equal_to<Source>()) : is_same_(std::move(is_same)) {}

  /// Whether a message of this source is used; if it is not that in use, it is so from now on.
  bool accepts(const Source& source) {
    run_ = last_ && is_same_(*last_, source) ? run_ + 1 : 1;
    last_ = source;
    const bool has_settled = run_ >= kMemory;
    if (has_settled) {
      changes_ = 0;
      refused_.reset();
    }
    if (current_ && is_same_(*current_, source)) return true;
    if (current_ && changes_ >= kMaxChanges) {
      refused_ = source;
      return false;
    }
    if (current_ && !has_settled) ++changes_;
    current_ = source;
    return true;
  }

  /// The source in use; empty before the first one.
  const std::optional<Source>& current() const { return current_; }
  /// The last one that was refused; empty: the description does not keep changing.
  const std::optional<Source>& refused() const { return refused_; }

 private:
  const IsSame is_same_;
  std::optional<Source> current_, last_, refused_;
  int run_ = 0;      ///< messages of last_ in a row
  int changes_ = 0;  ///< of current_ since a source was settled
};

}  // namespace gsv
