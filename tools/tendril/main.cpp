// tendril: one command for everything a person does with the robot, its model and its logs.
#include <fmt/core.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "commands.h"
#include "tendril/config/command_line.h"

namespace {

// Never throws, unlike fmt::print: the standard error may be closed.
template <typename... T>
void Complain(fmt::format_string<T...> format, T&&... values) {
  std::fputs(fmt::format(format, std::forward<T>(values)...).c_str(), stderr);
}

// A full disk or a closed output must not pass for success.
int CheckOutput() {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return 0;
  Complain("tendril: not everything could be written to the standard output: {}\n", std::strerror(errno));
  return 1;
}

// CLI11 takes -.5 for an option; -0.5 it knows as a number.
std::vector<std::string> WithLeadingZeros(int argc, const char* const* argv) {
  std::vector<std::string> words(argv, argv + argc);
  for (std::string& word : words) {
    if (word.size() > 2 && word[0] == '-' && word[1] == '.' && word[2] >= '0' && word[2] <= '9') {
      word.insert(1, "0");
    }
  }
  return words;
}

}  // namespace

int main(int argc, char** argv) {
  // A file that may not grow further is an error of whoever writes it, as a full disk is.
  std::signal(SIGXFSZ, SIG_IGN);
  const std::unique_ptr<CLI::App> app = tendril::tools::MakeApp();
  try {
    const std::vector<std::string> words = tendril::config::HelpAsOption(*app, WithLeadingZeros(argc, argv));
    std::vector<const char*> pointers;
    for (const std::string& word : words) pointers.push_back(word.c_str());
    app->parse(static_cast<int>(pointers.size()), pointers.data());
  } catch (const CLI::ParseError& e) {
    return app->exit(e) == 0 ? CheckOutput() : 2;
  } catch (const tendril::UsageError& e) {
    Complain("tendril: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    Complain("tendril: {}\n", e.what());
    return 1;
  }
  return CheckOutput();
}
