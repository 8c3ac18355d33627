#include "paths.h"

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <vector>

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

std::string Find(const std::vector<fs::path>& places, const std::string& name) {
  std::string tried;
  for (const auto& place : places) {
    std::error_code ignored;
    if (fs::is_regular_file(place / name, ignored)) return fs::weakly_canonical(place / name).string();
    tried += (tried.empty() ? "" : ", ") + (place / name).string();
  }
  throw std::runtime_error("cannot find " + name + " (looked for " + tried +
                           "); install Tendril completely or set TENDRIL_CONFIG_DIR");
}

fs::path BinaryFolder() {
  std::error_code ignored;
  return fs::read_symlink("/proc/self/exe", ignored).parent_path();
}

}  // namespace

std::string ConfigFile(const std::string& name) {
  std::vector<fs::path> places;
  if (const char* given = std::getenv("TENDRIL_CONFIG_DIR")) places.emplace_back(given);
  const fs::path bin = BinaryFolder();
  places.push_back(bin / "../share/tendril/config");
  places.push_back(bin / "../../../config");          // <source>/build/<preset>/bin
  places.emplace_back(TENDRIL_SOURCE_DIR "/config");  // any other build folder
  return Find(places, name);
}

std::string ScriptFile(const std::string& name) {
  const fs::path bin = BinaryFolder();
  return Find({bin / "../share/tendril", bin / "../../../tools", TENDRIL_SOURCE_DIR "/tools"}, name);
}

std::string SchemaFile(const std::string& kind) {
  const fs::path file = BinaryFolder() / "../share/tendril/schema" / (kind + ".schema.json");
  std::error_code ignored;
  return fs::is_regular_file(file, ignored) ? fs::weakly_canonical(file).string() : "";
}

}  // namespace tendril::tools
