// What a robot file says of a number after `within:`. Knows no key and no file.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>
#include <string_view>

#include "tendril/config/keys.h"
#include "tendril/core/uncertainty.h"

namespace tendril::config {

/// The accepted forms in words, for a number of this key.
std::string WithinAccepted(std::string_view key);

/// The same as a regular expression (ECMAScript), of those that are text.
inline constexpr std::string_view kWithinPattern =
    "^(known|unknown|([0-9]+\\.?[0-9]*|\\.[0-9]+)([eE][+-]?[0-9]+)? *%)$";

/// Of a number `value` of `key`. Throws ConfigError "'x' is ...; accepted: ...; remedy".
Uncertainty ReadWithin(const YAML::Node& within, std::string_view key, double value, Range range);
/// The same of a text outside any file: a person's answer.
Uncertainty ReadWithin(const std::string& within, std::string_view key, double value, Range range);

}  // namespace tendril::config
