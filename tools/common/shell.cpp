#include "shell.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <string_view>

namespace tendril::tools {

std::string ShellWord(const std::string& word) {
  const bool plain = !word.empty() && std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) ||
           std::string_view("_@%+=:,./-").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string CommandAsGiven(const std::string& program) {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::string line = program, word;
  std::getline(in, word, '\0');  // the program, wherever it is
  while (std::getline(in, word, '\0')) line.append(" ").append(ShellWord(word));
  return line;
}

}  // namespace tendril::tools
