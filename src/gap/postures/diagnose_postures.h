// The diagnosis of a change of a robot whose motors hold positions: its numbers learned from the runs before,
// then every single change weighed in those after.
#pragma once

#include "tendril/gap/diagnose.h"

namespace tendril::gap {

/// The runs before a change (all where none is marked) have enough states to learn the robot from.
bool CanLearnPostures(const DataSet& set);
/// The same, and so have the runs after.
bool CanDiagnosePostures(const DataSet& set);

/// Throws std::runtime_error as Diagnose does.
Diagnosis DiagnosePostures(const DataSet& set, const DiagnoseOptions& options);

}  // namespace tendril::gap
