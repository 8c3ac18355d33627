#include "python_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

extern char** environ;

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

struct Place {
  std::string interpreter;
  std::string package;  // folder with the package, if it is not installed for the interpreter
};

std::vector<Place> Places() {
  if (const char* given = std::getenv("TENDRIL_PYTHON"); given && *given) return {{given, {}}};
  std::error_code ignored;
  const fs::path bin = fs::read_symlink("/proc/self/exe", ignored).parent_path();
  return {{(bin / "../python/bin/python").string(), (bin / "../python_package").string()},  // of a build
          {(bin / "../lib/tendril/python/bin/python").string(), {}},  // of an installation
          {"python3", {}}};
}

/// A folder named tendril where the user happens to be is not the package.
void PrepareEnvironment(const Place& place) {
  setenv("PYTHONSAFEPATH", "1", 1);
  if (place.package.empty()) return;
  const char* before = std::getenv("PYTHONPATH");
  const std::string after = before ? before : "";
  setenv("PYTHONPATH", fmt::format("{}{}{}", place.package, after.empty() ? "" : ":", after).c_str(), 1);
}

std::vector<char*> Pointers(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

/// Whether the interpreter finds them; imports nothing but packages that they are in.
bool Has(const Place& place, const std::vector<std::string>& modules) {
  std::vector<std::string> words{place.interpreter, "-c",
                                 "import importlib.util as u, sys\n"
                                 "sys.exit(not all(u.find_spec(name) for name in sys.argv[1:]))",
                                 "tendril._core"};
  words.insert(words.end(), modules.begin(), modules.end());
  posix_spawn_file_actions_t quiet;
  posix_spawn_file_actions_init(&quiet);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    posix_spawn_file_actions_addopen(&quiet, stream, "/dev/null", O_RDWR, 0);
  pid_t child = 0;
  const int refused =
      posix_spawnp(&child, place.interpreter.c_str(), &quiet, nullptr, Pointers(words).data(), environ);
  posix_spawn_file_actions_destroy(&quiet);
  if (refused != 0) return false;
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/// Becomes it, in the environment that FindPython left.
[[noreturn]] void Become(const std::string& interpreter, const std::string& module,
                         const std::vector<std::string>& arguments) {
  std::vector<std::string> words{interpreter, "-m", module};
  words.insert(words.end(), arguments.begin(), arguments.end());
  execvp(interpreter.c_str(), Pointers(words).data());
  throw std::runtime_error(fmt::format("cannot start {}: {}", interpreter, std::strerror(errno)));
}

}  // namespace

// Leaves the environment as the interpreter that is found needs it.
std::string FindPython(const std::vector<std::string>& modules) {
  const char* before = std::getenv("PYTHONPATH");
  const std::string path = before ? before : "";
  for (const Place& place : Places()) {
    PrepareEnvironment(place);
    if (Has(place, modules)) return place.interpreter;
    if (before) {
      setenv("PYTHONPATH", path.c_str(), 1);
    } else {
      unsetenv("PYTHONPATH");
    }
  }
  return {};
}

void RunPython(const std::string& module, const std::vector<std::string>& arguments,
               const std::vector<std::string>& modules) {
  RunPythonIfThere(module, arguments, modules);
  std::vector<std::string> asked;
  for (const Place& place : Places()) asked.push_back(place.interpreter);
  throw std::runtime_error(fmt::format(
      "{} is a part of the Python package tendril{}, which none of these has: {}; install it with "
      "pip install './python[{}]' in the checkout (in a venv), or name the interpreter that has it "
      "in TENDRIL_PYTHON",
      module, modules.empty() ? "" : fmt::format(" (with {})", fmt::join(modules, ", ")),
      fmt::join(asked, ", "), module.substr(module.rfind('.') + 1)));
}

void RunPythonIfThere(const std::string& module, const std::vector<std::string>& arguments,
                      const std::vector<std::string>& modules) {
  if (const std::string interpreter = FindPython(modules); !interpreter.empty())
    Become(interpreter, module, arguments);
}

}  // namespace tendril::tools
