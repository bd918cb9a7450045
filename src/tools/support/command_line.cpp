#include "command_line.hpp"

#include <boost/program_options/errors.hpp>
#include <boost/program_options/parsers.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/variables_map.hpp>
#include <csignal>
#include <cstdio>
#include <exception>
#include <utility>

namespace ground_scale_vo {
namespace {

constexpr unsigned kLineLength = 100;
constexpr const char* kPositional = "positional arguments";  // not reachable as an option

struct HelpRequested {};

/// Boost's descriptions of an error span lines for some errors.
std::string firstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

void requireValues(const po::parsed_options& parsed) {
  for (const auto& option : parsed.options) {
    for (const std::string& value : option.value) {
      if (value.empty() && option.string_key != kPositional) {
        throw OptionError("--" + option.string_key + " needs a value");
      }
    }
  }
}

}  // namespace

CommandLine::CommandLine(std::string tool, std::string summary, std::string details)
    : tool_(std::move(tool)),
      summary_(std::move(summary)),
      details_(std::move(details)),
      options_("options", kLineLength) {
  options_.add_options()("help,h", "print this text");
}

void CommandLine::addPositional(const std::string& name, const std::string& help,
                                std::string* target, bool required) {
  positionals_.push_back({name, help, required, target, nullptr});
}

void CommandLine::addPositionals(const std::string& name, const std::string& help,
                                 std::vector<std::string>* target) {
  positionals_.push_back({name, help, false, nullptr, target});
}

void CommandLine::parse(int argc, char** argv) const {
  std::vector<std::string> values;
  po::options_description all;
  all.add(options_).add_options()(kPositional, po::value(&values));
  const po::positional_options_description positions =
      po::positional_options_description().add(kPositional, -1);
  using po::command_line_style::allow_guessing;
  using po::command_line_style::default_style;
  try {
    const po::parsed_options parsed = po::command_line_parser(argc, argv)
                                          .options(all)
                                          .positional(positions)
                                          .style(default_style & ~allow_guessing)
                                          .run();
    po::variables_map variables;
    po::store(parsed, variables);
    if (variables.count("help") > 0) throw HelpRequested();
    requireValues(parsed);
    if (variables.count(kPositional) > 0) {
      values = variables[kPositional].as<std::vector<std::string>>();
    }
    assignPositionals(values);
    po::notify(variables);
  } catch (const po::required_option& error) {
    throw OptionError(error.get_option_name() + " is missing, see --help");
  } catch (const po::error& error) {
    throw OptionError(firstLine(error.what()));
  }
}

void CommandLine::assignPositionals(const std::vector<std::string>& values) const {
  std::size_t used = 0;
  for (const Positional& positional : positionals_) {
    if (positional.all != nullptr) {
      positional.all->assign(values.begin() + static_cast<std::ptrdiff_t>(used), values.end());
      used = values.size();
    } else if (used < values.size()) {
      *positional.one = values[used++];
    } else if (positional.required) {
      throw OptionError(positional.name + " is missing, see --help");
    }
  }
  if (used < values.size()) {
    throw OptionError("there is one argument too many, '" + values[used] + "', see --help");
  }
}

std::string CommandLine::help() const {
  std::ostringstream text;
  text << "usage: " << tool_;
  for (const Positional& positional : positionals_) {
    const std::string name = positional.name + (positional.all != nullptr ? "..." : "");
    text << ' ' << (positional.required ? name : "[" + name + "]");
  }
  for (const auto& option : options_.options()) {
    if (!option->semantic()->is_required()) continue;
    text << ' ' << option->format_name() << ' ' << option->format_parameter();
  }
  text << " [options]\n\n" << summary_ << "\n\n";
  for (const Positional& positional : positionals_) {
    text << positional.name << ": " << positional.help << '\n';
  }
  text << (positionals_.empty() ? "" : "\n") << options_ << '\n' << details_ << '\n';
  return text.str();
}

int CommandLine::run(int argc, char** argv, const std::function<void()>& check,
                     const std::function<int()>& run) {
  int status = 2;
  // Under `ulimit -f`, writing fails with an error, instead of ending the process before it can
  // remove an incomplete file.
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    parse(argc, argv);
    check();
    status = 1;
    return run();
  } catch (const HelpRequested&) {
    std::fputs(help().c_str(), stdout);
    return 0;
  } catch (const OptionError& error) {
    std::fprintf(stderr, "%s: %s\n", tool_.c_str(), error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", tool_.c_str(), error.what());
    return status;
  }
}

}  // namespace ground_scale_vo
