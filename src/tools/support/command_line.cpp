#include "command_line.hpp"

#include <boost/program_options/errors.hpp>
#include <boost/program_options/parsers.hpp>
#include <boost/program_options/variables_map.hpp>
#include <csignal>
#include <cstdio>
#include <exception>
#include <utility>

namespace gsv {
namespace {

constexpr unsigned kLineLength = 100;

struct HelpRequested {};

/// Boost's descriptions of an error span lines for some errors.
std::string firstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

void requireValues(const po::parsed_options& parsed) {
  for (const auto& option : parsed.options) {
    for (const std::string& value : option.value) {
      if (value.empty() && option.position_key < 0) {
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
  auto* const value = po::value(target);
  positionals_.add_options()(name.c_str(), required ? value->required() : value, help.c_str());
  positions_.add(name.c_str(), 1);
}

void CommandLine::addPositionals(const std::string& name, const std::string& help,
                                 std::vector<std::string>* target) {
  positionals_.add_options()(name.c_str(), po::value(target)->multitoken(), help.c_str());
  positions_.add(name.c_str(), -1);
}

void CommandLine::parse(int argc, char** argv) const {
  po::options_description all;
  all.add(options_).add(positionals_);
  using po::command_line_style::allow_guessing;
  using po::command_line_style::default_style;
  try {
    const po::parsed_options parsed = po::command_line_parser(argc, argv)
                                          .options(all)
                                          .positional(positions_)
                                          .style(default_style & ~allow_guessing)
                                          .run();
    po::variables_map variables;
    po::store(parsed, variables);
    if (variables.count("help") > 0) throw HelpRequested();
    requireValues(parsed);
    po::notify(variables);
  } catch (const po::required_option& error) {
    const std::string option = error.get_option_name();  // with dashes, also a positional argument
    const bool is_positional = positionals_.find_nothrow(option.substr(2), false) != nullptr;
    throw OptionError(option.substr(is_positional ? 2 : 0) + " is missing, see --help");
  } catch (const po::error& error) {
    throw OptionError(firstLine(error.what()));
  }
}

std::string CommandLine::help() const {
  std::ostringstream text;
  text << "usage: " << tool_;
  for (const auto& option : positionals_.options()) {
    const auto semantic = option->semantic();
    const std::string name = option->long_name() + (semantic->max_tokens() > 1 ? "..." : "");
    text << ' ' << (semantic->is_required() ? name : "[" + name + "]");
  }
  for (const auto& option : options_.options()) {
    if (!option->semantic()->is_required()) continue;
    text << ' ' << option->format_name() << ' ' << option->format_parameter();
  }
  text << " [options]\n\n" << summary_ << "\n\n";
  for (const auto& option : positionals_.options()) {
    text << option->long_name() << ": " << option->description() << '\n';
  }
  text << (positionals_.options().empty() ? "" : "\n") << options_ << '\n' << details_ << '\n';
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

}  // namespace gsv
