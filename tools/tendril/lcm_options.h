// The options of every subcommand that talks to a daemon.
#pragma once

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

}  // namespace tendril::tools
