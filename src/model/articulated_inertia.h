// The inertia of a chain whose joints are free to yield, about a point. Knows nothing of robots.
#pragma once

#include "small_vectors.h"

namespace tendril::model {

// Inertia of disks about a point: force = mass a + cross alpha, moment = cross^T a + inertia alpha.
struct ArticulatedInertia {
  Symmetric mass, inertia;
  Mat cross{kZero, kZero, kZero};

  // To the point at -p: alpha there adds alpha x p to a here, a force here adds p x f to the moment there.
  void Shift(const Vec& p) {
    const Mat c = cross;
    cross.x +=
        Vec(mass.xz * p.y - mass.xy * p.z, mass.yz * p.y - mass.yy * p.z, mass.zz * p.y - mass.yz * p.z);
    cross.y +=
        Vec(mass.xx * p.z - mass.xz * p.x, mass.xy * p.z - mass.yz * p.x, mass.xz * p.z - mass.zz * p.x);
    cross.z +=
        Vec(mass.xy * p.x - mass.xx * p.y, mass.yy * p.x - mass.xy * p.y, mass.yz * p.x - mass.xz * p.y);
    inertia.xx += p.y * (c.x.z + cross.x.z) - p.z * (c.x.y + cross.x.y);
    inertia.xy += p.z * c.x.x - p.x * c.x.z + p.y * cross.y.z - p.z * cross.y.y;
    inertia.xz += p.x * c.x.y - p.y * c.x.x + p.y * cross.z.z - p.z * cross.z.y;
    inertia.yy += p.z * (c.y.x + cross.y.x) - p.x * (c.y.z + cross.y.z);
    inertia.yz += p.x * c.y.y - p.y * c.y.x + p.z * cross.z.x - p.x * cross.z.z;
    inertia.zz += p.x * (c.z.y + cross.z.y) - p.y * (c.z.x + cross.z.x);
  }
};

}  // namespace tendril::model
