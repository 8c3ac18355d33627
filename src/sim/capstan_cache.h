// Tables of the Capstan equation, kept: each takes some ten milliseconds, and a fit needs the same few
// repeatedly.
#pragma once

#include <memory>

#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"

namespace tendril::sim {

/// Thousandths of a millinewton, in half the time of 1e-6.
inline constexpr double kReplayedCapstan = 1e-5;

/// For tensions up to `most_N`; from any thread.
std::shared_ptr<const model::CapstanTable> CachedCapstanTable(const TransmissionParameters& transmission,
                                                              double most_N, double relative_error);

}  // namespace tendril::sim
