#pragma once

#include <locale>
#include <string>

namespace ground_scale_vo::test {

/// While it lives, streams write 1.234,5 by default, as in German.
class CommaLocale {
 public:
  CommaLocale() : previous_(std::locale::global({std::locale::classic(), new Punctuation})) {}
  ~CommaLocale() { std::locale::global(previous_); }
  CommaLocale(const CommaLocale&) = delete;
  CommaLocale& operator=(const CommaLocale&) = delete;

 private:
  class Punctuation : public std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };

  const std::locale previous_;
};

}  // namespace ground_scale_vo::test
