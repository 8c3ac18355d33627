// Opening LCM with errors that say what to do. Knows nothing of messages.
#pragma once

#include <memory>
#include <string>

namespace lcm {
class LCM;
}

namespace tendril::io {

/// Opens an LCM connection: kLcmUrlRule says which addresses there are; empty: LCM_DEFAULT_URL, or this
/// computer alone. Throws std::runtime_error with the remedy when that does not work; for udpm without a
/// multicast route at once.
std::unique_ptr<lcm::LCM> OpenLcm(const std::string& url);

/// PREFIX_NAME. Throws std::runtime_error when the prefix is empty, longer than 40 characters or has others
/// than letters, digits and '_'.
std::string ChannelName(const std::string& prefix, const std::string& name);

/// Handles what waits, after at most timeout_ms for the first message; with 0 never waits. Returns how many.
/// A flood ends it after about timeout_ms, or after 10,000 messages.
int HandleWaiting(lcm::LCM& lcm, int timeout_ms);

}  // namespace tendril::io
