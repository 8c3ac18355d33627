// The error of whoever asks for something that makes no sense, apart from that of a file or of work that
// failed. Programs exit with 2 after it.
#pragma once

#include <stdexcept>

namespace tendril {

/// A wrong name, options that exclude each other, a file that would be replaced. what() is the whole line.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tendril
