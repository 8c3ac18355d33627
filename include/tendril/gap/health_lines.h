// Findings about a data set as few lines for a terminal. Knows nothing of how they are found.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// "wrong data: RUN: CHANNEL (and 2 more like it): TEXT", or "data: ..." where it is no error: what is worst
/// first, findings that differ only in their numbers as one, information only about the files. Of more than
/// `most` lines the last says how many are left out.
std::vector<std::string> FindingLines(const std::vector<HealthFinding>& findings, std::size_t most = 24);

/// "RUN and 2 more: CHANNEL TEXT": the first error of each channel, in the order of the findings.
std::vector<std::string> ErrorLines(const std::vector<HealthFinding>& findings);

}  // namespace tendril::gap
