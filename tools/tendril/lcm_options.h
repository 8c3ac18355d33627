// The options of every subcommand that talks to a daemon.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <string>

#include "tendril/core/daemon.h"
#include "tendril/io/client.h"

namespace tendril::tools {

struct LcmOptions {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  std::string prefix = "TENDRIL";
};

inline CLI::Validator ChannelPrefix() {
  return {[](std::string& prefix) {
            if (IsChannelPrefix(prefix)) return std::string();
            return "'" + prefix + "' is not a prefix; accepted: " + std::string(kChannelPrefixRule) +
                   "; correct it";
          },
          ""};
}

inline CLI::Validator LcmUrl() {
  return {[](std::string& url) {
            if (url.empty() || IsLcmUrl(url)) return std::string();  // empty is refused everywhere
            return "'" + url + "' is not an LCM address; accepted: " + std::string(kLcmUrlRule) +
                   "; correct it";
          },
          ""};
}

inline void AddLcmOptions(CLI::App& app, LcmOptions& options) {
  app.add_option("--lcm", options.url, "LCM address, as in the daemon's lcm.url")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str()
      ->check(LcmUrl());
  app.add_option("--prefix", options.prefix, "as in the daemon's lcm.channel_prefix")
      ->capture_default_str()
      ->check(ChannelPrefix());
}

/// Of those that command.
inline void AddKeyOption(CLI::App& app) {
  app.add_option_function<std::string>(
         "--key", [](const std::string& file) { setenv("TENDRIL_KEY_FILE", file.c_str(), 1); },
         "file with the key with which commands are signed, as in the daemon's lcm.key_file")
      ->envname("TENDRIL_KEY_FILE")
      ->type_name("FILE")
      ->check(CLI::ExistingFile);
}
inline void AddOperatorOptions(CLI::App& app, LcmOptions& options) {
  AddLcmOptions(app, options);
  AddKeyOption(app);
}

/// When no state came within some time.
inline std::string NobodyAnswers(const LcmOptions& lcm, double within_s, const io::Client& client) {
  return io::NobodyAnswers(lcm.url, lcm.prefix, within_s, client);
}

}  // namespace tendril::tools
