#include "tendril/config/left_out.h"

#include <yaml-cpp/yaml.h>

#include "tendril/config/config.h"

namespace tendril::config {
namespace {

void CollectLeftOut(const YAML::Node& resolved, const YAML::Node& given, const std::string& path,
                    std::string& found) {
  for (const auto& entry : resolved) {
    const std::string key = entry.first.Scalar(), at = path.empty() ? key : path + "." + key;
    const YAML::Node there = given.IsMap() ? given[key] : YAML::Node();
    if (!there.IsDefined() || there.IsNull()) {
      if (!found.empty()) found += ", ";
      found += at;
      if (entry.second.IsScalar()) found += ": " + entry.second.Scalar();
    } else if (entry.second.IsMap()) {
      CollectLeftOut(entry.second, there, at, found);
    }
  }
}

}  // namespace

std::string LeftOut(const DaemonParameters& daemon, const std::string& path) {
  std::string found;
  CollectLeftOut(YAML::Load(ToYaml(daemon)), YAML::LoadFile(path), "", found);
  return found;
}

}  // namespace tendril::config
