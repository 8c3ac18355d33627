// The dashboard of `tendril status --watch`, which is a part of the Python package.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>

#include "lcm_options.h"

namespace tendril::tools {

struct DashboardOptions {
  std::optional<double> tip_speed_mmps, bend_speed_radps, release_ms;
};

void AddDashboardOptions(CLI::App& app, DashboardOptions& options);

/// Becomes the dashboard; returns where there is none to become: no terminal, or no Python package.
void BecomeDashboard(const LcmOptions& lcm, const DashboardOptions& options);

/// For who shows the table instead: throws UsageError where one of them is given.
void RefuseDashboardOptions(const DashboardOptions& options);

}  // namespace tendril::tools
