#pragma once

#include <cstdio>
#include <exception>
#include <string>

namespace ground_scale_vo {

/// What main() is in every tool: --help prints the usage; wrong arguments end with status 2, data
/// that cannot be used with 1, each after one sentence on stderr. parse(argc, argv) gives the
/// arguments, run(arguments) does the work; both throw std::exception.
template <typename Parse, typename Run>
int toolMain(const char* name, const char* usage, int argc, char** argv, Parse parse, Run run) {
  for (int i = 1; i < argc; ++i) {
    if (argv[i] == std::string("--help") || argv[i] == std::string("-h")) {
      std::fputs(usage, stdout);
      return 0;
    }
  }
  int status = 2;
  try {
    const auto arguments = parse(argc, argv);
    status = 1;
    run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", name, error.what());
    return status;
  }
  return 0;
}

}  // namespace ground_scale_vo
