// Opens LCM connections, with errors that name the remedy. Knows nothing of messages.
#pragma once

#include <memory>
#include <string>

namespace lcm {
class LCM;
}

namespace tendril::io {

/// Opens an LCM connection to an address as in kLcmUrlRule; empty: LCM_DEFAULT_URL, or this computer alone.
/// Throws std::runtime_error with the remedy when that fails; for udpm without a multicast route at once.
std::unique_ptr<lcm::LCM> OpenLcm(const std::string& url);

/// PREFIX_NAME. Throws std::runtime_error when the prefix is empty, longer than 40 characters or has
/// characters other than letters, digits and '_'.
std::string ChannelName(const std::string& prefix, const std::string& name);

/// Handles waiting messages, after at most timeout_ms for the first one; 0 never waits. Returns how many.
/// Under a flood it returns after about timeout_ms or 10,000 messages.
int HandleWaiting(lcm::LCM& lcm, int timeout_ms);

}  // namespace tendril::io
