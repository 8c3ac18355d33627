// The paper's claims recomputed: its values beside ours, verdict and reason. Knows nothing of the program
// that asks; the page with the plots is drawn by tools/report_reproduce.py.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "claims.h"
#include "study.h"

namespace tendril::qi2021 {

/// Computes everything and writes the series behind it (*.csv) into the folder; takes a minute.
std::vector<JudgedClaim> Recompute(const std::filesystem::path& folder, ConfigFinder find,
                                   StageProgress progress);

/// Throws std::runtime_error when the file cannot be written.
void WriteJson(const std::filesystem::path& path, const std::vector<JudgedClaim>& claims, double wall_s);
/// For a terminal: a line a claim with its reason below it, and how many hold.
std::string TableOf(const std::vector<JudgedClaim>& claims);

}  // namespace tendril::qi2021
