// The files of src/gap/report and the plotting library, as the build embeds them (cmake/TendrilEmbed.cmake).
// Knows nothing of what they say.
#pragma once

#include <string_view>

namespace tendril::gap::page {

extern const std::string_view kTemplate, kStyle, kScript, kD3, kLicence;

}  // namespace tendril::gap::page
