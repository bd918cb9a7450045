#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "graph.hpp"

namespace gsv {

/// A program started by the test in its own process group, which the destructor kills unless the
/// program is known to have ended. Records its stdout and stderr.
class ChildProcess {
 public:
  /// command_line: program and arguments.
  explicit ChildProcess(std::vector<std::string> command_line) {
    std::string name = std::filesystem::temp_directory_path() / "ground_scale_vo_child_XXXXXX";
    const int file = mkstemp(name.data());
    if (file < 0) throw std::runtime_error("no temporary file");
    log_ = name;
    std::vector<char*> argv;
    for (std::string& word : command_line) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      setpgid(0, 0);
      dup2(file, STDOUT_FILENO);
      dup2(file, STDERR_FILENO);
      execvp(argv[0], argv.data());
      _exit(127);
    }
    close(file);
  }
  ~ChildProcess() {
    if (!status_) {
      kill(-pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    std::filesystem::remove(log_);
  }
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Sends a signal to the program only, not to its process group.
  void send(int signal) const {
    if (!status_) kill(pid_, signal);
  }
  bool running() {
    if (!status_) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) == pid_) status_ = status;
    }
    return !status_;
  }
  /// Exit status as in a shell: 128 + n if ended by signal n; empty if it did not end within
  /// `timeout` [s].
  std::optional<int> waitForEnd(double timeout = kTimeout) {
    if (!waitUntil([this] { return !running(); }, timeout)) return std::nullopt;
    return WIFSIGNALED(*status_) ? 128 + WTERMSIG(*status_) : WEXITSTATUS(*status_);
  }
  /// Its output so far.
  std::string output() const {
    std::ostringstream text;
    text << std::ifstream(log_).rdbuf();
    return text.str();
  }

 private:
  pid_t pid_ = -1;
  std::filesystem::path log_;
  std::optional<int> status_;
};

}  // namespace gsv
