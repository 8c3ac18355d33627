// The robots of this room's tests, built by hand; reference/make_goldens.py states the same ones.
#pragma once

#include <Eigen/Core>
#include <numbers>
#include <random>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::test {

inline std::vector<TendonRoute> Around(int count, double radius_m, double offset_rad = 0) {
  std::vector<TendonRoute> routes;
  for (int k = 0; k < count; ++k) routes.push_back({offset_rad + 2 * std::numbers::pi * k / count, radius_m});
  return routes;
}

/// The paper's 90 mm robot (or one with other units), upright, no damping.
inline BodyParameters PaperBody(int units = 4, double unit_length_m = 0.0225) {
  SectionParameters s;
  s.units = units;
  s.unit_length_m = unit_length_m;
  s.unit_mass_kg = 0.0025;
  s.disk_inertia_xx_kgm2 = 0.0025 * 0.010 * 0.010 / 16;
  s.disk_inertia_zz_kgm2 = 0.0025 * 0.010 * 0.010 / 8;
  s.youngs_modulus_Pa = 2.3e10;
  s.core_radius_m = 0.0005;
  s.tendons = Around(3, 0.004);
  BodyParameters body;
  body.sections = {s};
  return body;
}

/// Everything different between the sections, gravity askew, damping, disks that are no thin plates.
inline BodyParameters TwoSections() {
  SectionParameters a;
  a.units = 3;
  a.unit_length_m = 0.020;
  a.unit_mass_kg = 0.0030;
  a.disk_inertia_xx_kgm2 = 2.5e-8;
  a.disk_inertia_zz_kgm2 = 3.5e-8;
  a.youngs_modulus_Pa = 2.3e10;
  a.core_radius_m = 0.0006;
  a.bending_damping_Nms = 3e-5;
  a.tendons = Around(3, 0.005);
  SectionParameters b;
  b.units = 2;
  b.unit_length_m = 0.025;
  b.unit_mass_kg = 0.0015;
  b.disk_inertia_xx_kgm2 = 1.4e-8;
  b.disk_inertia_zz_kgm2 = 1.1e-8;
  b.youngs_modulus_Pa = 3.1e10;
  b.core_radius_m = 0.0004;
  b.bending_damping_Nms = 1e-5;
  b.tendons = Around(4, 0.0035, 0.3);
  BodyParameters body;
  body.sections = {a, b};
  body.gravity_W_mps2 = {2.0, -3.0, 8.5};
  return body;
}

/// The two sections as they may have been built and loaded: a payload and a steady force at the tip, twisted
/// holes, a soft unit and two that are bent by themselves.
inline BodyParameters AsBuilt() {
  BodyParameters body = TwoSections();
  body.tip_payload_kg = 0.002;
  body.tip_force_W_N = {0.02, -0.03, 0.01};
  body.twist_rad_per_m = 4;
  body.unit_deviations = {{.unit = 1, .rest_u_rad = 0.15, .rest_v_rad = -0.1},
                          {.unit = 3, .stiffness_scale = 0.8},
                          {.unit = 4, .stiffness_scale = 1.1, .rest_v_rad = 0.2}};
  return body;
}

/// Numbers that are the same on every machine (the distributions of <random> need not be).
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double Uniform(double low, double high) { return low + (high - low) * (engine_() / 4294967296.0); }
  Eigen::VectorXd Vector(Eigen::Index n, double low, double high) {
    Eigen::VectorXd x(n);
    for (double& value : x) value = Uniform(low, high);
    return x;
  }

 private:
  std::mt19937 engine_;
};

/// A robot of random numbers whose sections bend, twist and stretch in every combination, with one to three
/// units a disk: some of it rests twisted or stretched, its holes may be turned against each other, its base
/// may hang.
inline BodyParameters RandomStrained(unsigned seed) {
  Random random(seed);
  BodyParameters body;
  for (unsigned k = 0; k < 1 + seed % 2; ++k) {
    SectionParameters s;
    s.units_per_disk = 1 + static_cast<int>((seed + k) % 3);
    s.units = 2 * s.units_per_disk;
    s.unit_length_m = random.Uniform(0.008, 0.02);
    s.unit_mass_kg = random.Uniform(0.0005, 0.002);
    s.disk_mass_kg = random.Uniform(0.001, 0.003);
    s.disk_inertia_xx_kgm2 = random.Uniform(1e-8, 2e-8);
    s.disk_inertia_zz_kgm2 = random.Uniform(1e-8, 3e-8);
    s.youngs_modulus_Pa = random.Uniform(1e10, 3e10);
    s.core_radius_m = random.Uniform(0.0004, 0.0006);
    s.bending_damping_Nms = random.Uniform(0, 3e-5);
    s.torsion = (seed + k) % 4 != 1;
    s.extension = (seed + k) % 4 != 2;
    s.shear = (seed + k) % 2 == 0;
    if (s.torsion || s.shear) s.poissons_ratio = 0.3;
    if (s.torsion) {
      s.torsional_damping_Nms = random.Uniform(0, 1e-5);
      s.rest_torsion_rad_per_m = random.Uniform(-10, 10);
    }
    if (s.extension) {
      s.axial_stiffness_N = random.Uniform(20, 200);  // a spring: soft enough to be seen
      s.axial_damping_Nspm = random.Uniform(0, 0.05);
      s.rest_extension = random.Uniform(-0.05, 0.05);
    }
    if (s.shear) {
      s.shear_stiffness_N = random.Uniform(20, 200);
      s.shear_damping_Nspm = random.Uniform(0, 0.05);
    }
    s.tendons = Around(3 + static_cast<int>(k), random.Uniform(0.003, 0.005), random.Uniform(0, 1));
    if (seed % 2 == 1) {  // tapered, helical, crossing, and one that ends before the last disk
      s.tendons[0].turn_rad_per_m = random.Uniform(5, 40);
      s.tendons[1].turn_rad_per_m = random.Uniform(-40, -5);
      s.tendons[1].end_radius_m = random.Uniform(0.002, 0.003);
      s.tendons[2].ends_at_disk = 1;
    }
    body.sections.push_back(s);
  }
  body.gravity_W_mps2 = random.Vector(3, -9, 9);
  body.tip_force_W_N = random.Vector(3, -0.02, 0.02);
  body.tip_payload_kg = random.Uniform(0, 0.002);
  if (seed % 3 == 0) body.twist_rad_per_m = random.Uniform(-5, 5);
  body.DeviationOf(2).rest_u_rad = random.Uniform(-0.2, 0.2);
  body.DeviationOf(2).stiffness_scale = random.Uniform(0.8, 1.2);
  return body;
}

}  // namespace tendril::test
