// Files of config/ as the build embeds them (cmake/TendrilEmbed.cmake), for programs that read only what they
// are given. Knows nothing of what they say.
#pragma once

#include <string_view>

namespace tendril::tools {

extern const std::string_view kDaemonFile;  // config/tendrild.yaml

}  // namespace tendril::tools
