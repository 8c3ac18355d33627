// Ctrl-C, SIGTERM and SIGHUP (the terminal closes) as a request to end in order. Knows nothing of the work.
#pragma once

#include <atomic>
#include <string>

namespace tendril::tools {

/// From now on these signals do not end the program: they set the flag that is returned.
const std::atomic<bool>& CatchStopSignals();

/// "Ctrl-C", "SIGTERM" or "SIGHUP", whichever came last; empty: none.
std::string StoppedBy();

}  // namespace tendril::tools
