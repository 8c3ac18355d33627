// A file as one YAML document, and its nodes as error messages name them. Knows nothing of keys.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>
#include <string_view>

#include "reader.h"

namespace tendril::config {

/// Text of the file, made safe for a one-line message.
std::string Printable(std::string_view text);

/// "a list", "text in quotes".
std::string_view TypeName(const YAML::Node& node);

/// Reads the text as exactly one YAML document holding a mapping. Throws ConfigError.
Layer ParseDocument(const std::string& yaml, const Source& source, std::string_view expected);

}  // namespace tendril::config
