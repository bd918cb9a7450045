// Runs a fuzz target on its corpus, then on mutations of it, each of which depends only on the seed
// and its number:
//
//   X_fuzz [SEED [FIRST [COUNT]]]
//
// (defaults: 1, 0, as planned by the target). A crash prints the arguments that run its input
// alone.

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <random>

#include "fuzz_target.hpp"
#include "support/long_tests.hpp"

namespace gsv::fuzz {
namespace {

unsigned long long seed = 1, number = 0, count = 0;  // NOLINT: of the command line

extern "C" void nameInput(int signal) {
  std::fprintf(stderr, "signal %d: reproduce it with the arguments %llu %llu 1\n", signal, seed,
               number);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

/// Makes random changes to an input of the corpus. Words are edge cases for parsers of numbers and
/// of KITTI files.
std::string mutated(const std::vector<std::string>& corpus) {
  static const char* const kWords[] = {
      "nan", "-inf", "1e400", "1e-400", "0",     "-0",   "-1",         "1e308", "1e19",
      "1e9", "0x1p", "1,5",   "",       "x",     "\n",   "\r\n",       " ",     "\t",
      "#",   "P0:",  "=",     "/",      "0.001", "true", "4294967296", "--",    "1e-320"};
  const char* const kBlank = " \t\r\n=";
  constexpr std::size_t kMaxSize = 1u << 16;  // [bytes]
  std::mt19937_64 random(seed * 0x9E3779B97F4A7C15u + number);
  const auto below = [&](std::size_t limit) { return random() % limit; };
  std::string input = corpus[below(corpus.size())];
  for (std::size_t k = below(6) + 1; k > 0; --k) {
    const std::size_t at = below(input.size() + 1), change = below(5);
    if (change == 0 && at < input.size()) {
      input[at] ^= static_cast<char>(1u << below(8));
    } else if (change == 1) {
      input.erase(at, below(4) > 0 ? below(16) + 1 : std::string::npos);
    } else if (change == 2) {
      const std::string& other = corpus[below(corpus.size())];
      input = input.substr(0, at) + other.substr(below(other.size() + 1));
    } else if (change == 3) {
      const std::size_t begin = std::min(input.find_first_not_of(kBlank, at), input.size());
      const std::size_t end = std::min(input.find_first_of(kBlank, begin), input.size());
      input.replace(begin, end - begin, kWords[below(std::size(kWords))]);
    } else {
      for (std::size_t n = below(8) + 1; n > 0; --n) {
        input.insert(at, 1, static_cast<char>(random()));
      }
    }
  }
  return input.substr(0, kMaxSize);
}

TEST(Fuzz, HandlesEveryInput) {
  Plan target = plan();
  target.corpus.emplace_back();
  if (count == 0) count = runsLongTests() ? target.inputs : target.inputs / 3;
  for (const auto end = number + count; number < end; ++number) {
    run(number < target.corpus.size() ? target.corpus[number] : mutated(target.corpus));
  }
}

}  // namespace
}  // namespace gsv::fuzz

int main(int argc, char** argv) {
  using namespace gsv::fuzz;
  testing::InitGoogleTest(&argc, argv);
  testing::GTEST_FLAG(catch_exceptions) = false;  // an exception ends the process as a signal does
  unsigned long long* const arguments[] = {&seed, &number, &count};
  for (int i = 1; i < std::min(argc, 4); ++i) *arguments[i - 1] = std::stoull(argv[i]);
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGBUS}) std::signal(signal, nameInput);
  return RUN_ALL_TESTS();
}
