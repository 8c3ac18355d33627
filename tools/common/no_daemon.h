// Message of a program when no daemon answers.
#pragma once

#include <fmt/format.h>

#include <string>

#include "tendril/io/client.h"

namespace tendril::tools {

/// For no message from a daemon within some time; a daemon that waits for its networks reports that.
inline std::string NobodyAnswers(const std::string& url, const std::string& prefix, double within_s,
                                 const io::Client& client) {
  if (!client.waits().empty())
    return fmt::format("the daemon does not control anything yet, it is {}", client.waits());
  return fmt::format(
      "no daemon answers on {} ({}_STATE) within {:g} s; is tendrild running, with the same --lcm and "
      "--prefix?",
      url, prefix, within_s);
}

}  // namespace tendril::tools
