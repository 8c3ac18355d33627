// Which Tendril this is: what --version prints and what each log carries.
// Knows nothing but what the build wrote down.
#pragma once

#include <string_view>

namespace tendril {

/// The release, for example "0.1.0".
std::string_view Version();

/// `git describe` of the source tree at build time, "-dirty" when it had uncommitted changes; "unknown"
/// without git.
std::string_view GitRevision();

}  // namespace tendril
