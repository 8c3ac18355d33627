// A diagnosis of each verdict as it could come from a real set of runs, for tests of the report. Knows
// nothing of how diagnoses are made.
#pragma once

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

Diagnosis ExampleDiagnosis(Verdict verdict);

}  // namespace tendril::gap
