#pragma once

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/value_semantic.hpp>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"

namespace gsv {

namespace po = boost::program_options;

/// The command line of a tool: options of Boost.Program_options, named positional arguments,
/// --help, and the exit statuses that all tools share.
class CommandLine {
 public:
  /// summary: what the tool does, for --help. details: text after the options in --help.
  CommandLine(std::string tool, std::string summary, std::string details);

  /// One positional argument, or all further ones. The target must outlive run().
  void addPositional(const std::string& name, const std::string& help, std::string* target,
                     bool required = true);
  void addPositionals(const std::string& name, const std::string& help,
                      std::vector<std::string>* target);

  /// The options: options().add_options()("name", value, "help"). Their notifiers may throw
  /// OptionError.
  po::options_description& options() { return options_; }

  /// What main() does: parses the arguments into the targets, calls check(), which throws
  /// OptionError when arguments do not fit together, and then run(). Returns the exit status: that
  /// of run(), 0 after --help, 1 when run() throws std::exception, 2 when the arguments cannot be
  /// used. A failure is one sentence on stderr.
  int run(int argc, char** argv, const std::function<void()>& check,
          const std::function<int()>& run);

 private:
  void parse(int argc, char** argv) const;
  std::string help() const;

  const std::string tool_, summary_, details_;
  po::options_description options_, positionals_;
  po::positional_options_description positions_;  ///< the order of positionals_
};

/// An optional value. --help shows what the target holds now as its default. `unit` is how --help
/// names the value: "M", "N", "FILE".
template <typename T>
po::typed_value<T>* optionalValue(T* target, const char* unit) {
  std::ostringstream text;
  text << *target;
  return po::value<T>(target)->default_value(*target, text.str())->value_name(unit);
}

/// --set GROUP/NAME=VALUE, any number of times.
inline po::typed_value<std::vector<std::string>>* settingsValue(std::vector<std::string>* target) {
  return po::value(target)->composing()->value_name("GROUP/NAME=VALUE");
}
constexpr const char* kSettingsHelp =
    "sets an option to a value other than its default (docs/reference/parameters.md); may be "
    "repeated";

/// A topic of a bag. Its name gets the leading slash of a recorded topic when it has none.
inline po::typed_value<std::string>* topicValue(std::string* target) {
  return po::value(target)->value_name("TOPIC")->notifier([=](const std::string& topic) {
    *target = topic.empty() || topic.front() == '/' ? topic : "/" + topic;
  });
}

/// A value without which the command line is refused.
template <typename T>
po::typed_value<T>* requiredValue(T* target, const char* unit) {
  return po::value<T>(target)->required()->value_name(unit);
}

/// A number in [min, max].
template <typename Number>
po::typed_value<Number>* numberInRange(const std::string& option, Number* target, const char* unit,
                                       double min, double max) {
  return optionalValue(target, unit)->notifier([=](Number value) {
    requireInRange(option.c_str(), static_cast<double>(value), min, max);
  });
}

}  // namespace gsv
