// One value as a person gives it, outside any file: the same rules and the same words as in a file. Knows
// nothing of questions.
#pragma once

#include <string>
#include <utility>

#include "tendril/config/keys.h"
#include "tendril/core/uncertainty.h"

namespace tendril::config {

/// A number of `key`, whose path is its name, within its range and choices. A known unit may follow ("60 mm"
/// for a key in m). Throws ConfigError "length_m: 60 is out of range; accepted: ...; remedy".
double ReadNumber(const Key& key, const std::string& text);
/// "2.3e10 within 10 %" as the number and what follows `within`; that is empty where nothing does.
std::pair<std::string, std::string> PartsOfAnswer(const std::string& text);
/// What follows `within`, said of the number `value` of `key`; a known unit may follow a deviation. Throws as
/// ReadNumber.
Uncertainty ReadUncertainty(const Key& key, const std::string& text, double value);
/// A text or choice of `key`.
std::string ReadText(const Key& key, const std::string& text);

/// The key of this path among them. Throws std::out_of_range.
const Key& KeyAt(const std::vector<Key>& keys, const std::string& path);

/// The file's text with each key's meaning, accepted values and unit as comment lines above its first
/// occurrence.
std::string WithMeanings(const std::string& yaml, const std::vector<Key>& keys);

}  // namespace tendril::config
