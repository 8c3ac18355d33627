// Files of config/ embedded by the build (cmake/TendrilEmbed.cmake), for programs that read no other files.
// Knows nothing of their contents.
#pragma once

#include <string_view>

namespace tendril::experiment {

extern const std::string_view kDaemonFile;  // config/tendrild.yaml

}  // namespace tendril::experiment
