// The paper, part by part; each finds its claims. Knows only their names.
#pragma once

#include "study.h"

namespace tendril::qi2021 {

void CircleGeometry(Study& study);     // eq. 31
void ZeroTension(Study& study);        // 3.1, Fig. 4
void SingleTendon(Study& study);       // 3.2, Fig. 5
void PulleyCurves(Study& study);       // 4, Fig. 7
void PlanarBend(Study& study);         // 5.1, Fig. 11
void SpatialCircle(Study& study);      // 5.2, Fig. 13
void ConstantCurvature(Study& study);  // 6

}  // namespace tendril::qi2021
