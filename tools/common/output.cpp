#include "output.h"

#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "paths.h"

namespace tendril::tools {

namespace fs = std::filesystem;

fs::path MakeOutputFolder(const fs::path& folder, const std::string& remedy) {
  std::error_code error;
  fs::create_directories(folder, error);
  const bool usable = !error && fs::is_directory(folder) && access(folder.c_str(), W_OK | X_OK) == 0;
  if (!usable) {
    throw std::runtime_error("cannot write into " + folder.string() +
                             (error ? " (" + error.message() + ")" : "") + ": " + remedy);
  }
  return folder;
}

void RunPlotScript(const std::string& script, const std::vector<fs::path>& folders,
                   const std::string& result) {
  // By its full path: Python looks for its modules beside the one found in PATH.
  std::vector<std::string> arguments{"/usr/bin/python3", ScriptFile(script)};
  for (const auto& f : folders) arguments.push_back(f.string());
  std::vector<char*> argv;
  for (auto& a : arguments) argv.push_back(a.data());
  argv.push_back(nullptr);
  int ends[2];
  if (pipe(ends) != 0) throw std::runtime_error("cannot start " + script + ": " + std::strerror(errno));
  const pid_t child = fork();
  if (child == 0) {
    dup2(ends[1], STDERR_FILENO);
    close(ends[0]);
    close(ends[1]);
    execv(argv[0], argv.data());
    _exit(127);
  }
  close(ends[1]);
  std::string said;
  char part[4096];
  for (ssize_t n; (n = read(ends[0], part, sizeof part)) != 0;) {
    if (n < 0 && errno != EINTR) break;
    if (n > 0) said.append(part, static_cast<std::size_t>(n));
  }
  close(ends[0]);
  int status = 0;
  while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (child > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
  // A Python program ends with its error on the last line.
  while (!said.empty() && said.back() == '\n') said.pop_back();
  said.erase(0, said.rfind('\n') + 1);
  if (said.empty()) said = "/usr/bin/python3 did not run; sudo apt-get install python3 python3-matplotlib";
  throw std::runtime_error(result + " could not be drawn (everything else is written): " + said +
                           "; --no-plots skips it");
}

}  // namespace tendril::tools
