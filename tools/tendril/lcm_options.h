// The options of every subcommand that talks to a daemon.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>

#include "tendril/core/daemon.h"

namespace tendril::tools {

struct LcmOptions {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  std::string prefix = "TENDRIL";
};

inline CLI::Validator ChannelPrefix() {
  return {[](std::string& prefix) {
            if (IsChannelPrefix(prefix)) return std::string();
            return "'" + prefix + "' is no prefix; accepted: " + std::string(kChannelPrefixRule) +
                   "; correct it";
          },
          ""};
}

inline void AddLcmOptions(CLI::App& app, LcmOptions& options) {
  app.add_option("--lcm", options.url, "LCM address, as in the daemon's lcm.url")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  app.add_option("--prefix", options.prefix, "as in the daemon's lcm.channel_prefix")
      ->capture_default_str()
      ->check(ChannelPrefix());
}

/// What a daemon without its networks tells once a second in place of states.
inline bool TellsThatItWaits(const std::string& source, const std::string& text) {
  return source == "daemon" && text.starts_with("waiting: ");
}

/// When no state came within some time. `waits`: what the daemon told that it waits for, if it did.
inline std::string NobodyAnswers(const LcmOptions& lcm, double within_s, const std::string& waits) {
  if (!waits.empty()) return fmt::format("the daemon does not control anything yet, it is {}", waits);
  return fmt::format(
      "no daemon answers on {} ({}_STATE) within {:g} s; is tendrild running, with the same --lcm and "
      "--prefix?",
      lcm.url, lcm.prefix, within_s);
}

}  // namespace tendril::tools
