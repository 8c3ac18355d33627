// The files of src/gap/report and the plotting library, embedded by the build (cmake/TendrilEmbed.cmake).
#pragma once

#include <string_view>

namespace tendril::gap::page {

extern const std::string_view kTemplate, kStyle, kScript, kD3, kLicence;

}  // namespace tendril::gap::page
