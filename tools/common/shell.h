// Commands as text that can be pasted into a shell. Knows no command.
#pragma once

#include <string>

namespace tendril::tools {

/// A word as a shell takes it for one, in single quotes where it needs any.
std::string ShellWord(const std::string& word);

/// The command line of this process with `program` as its first word.
std::string CommandAsGiven(const std::string& program);

}  // namespace tendril::tools
