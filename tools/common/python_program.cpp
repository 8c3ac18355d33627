// A stand-in, until the package brings its own search for an interpreter.
#include "python_program.h"

#include <unistd.h>

#include <cstdlib>
#include <stdexcept>

namespace tendril::tools {

int RunPython(const std::string& module, const std::vector<std::string>& arguments) {
  const char* given = std::getenv("TENDRIL_PYTHON");
  const std::string python = given != nullptr && *given != '\0' ? given : "python3";
  std::vector<std::string> words{python, "-m", module};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  execvp(pointers[0], pointers.data());
  throw std::runtime_error("no Python (" + python +
                           ") with the package tendril; install it, or name one in TENDRIL_PYTHON");
}

}  // namespace tendril::tools
