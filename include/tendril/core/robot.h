// The robot as plain numbers with their units. Filled by config/, consumed by model/, control/ and sim/;
// knows nothing of files.
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tendril/core/uncertainty.h"

namespace tendril {

/// Where a tendon passes the disks: at the arc length s from the base through a hole at the distance r(s)
/// from the disk's centre and the angle angle_rad + turn_rad_per_m s about its z.
struct TendonRoute {
  double angle_rad = 0;
  double radius_m = 0;                   // everywhere, or at the base where end_radius_m is given
  double turn_rad_per_m = 0;             // a helix; tendons of different turns cross
  std::optional<double> end_radius_m{};  // at its last disk, r(s) linear between
  int ends_at_disk = 0;                  // of its section, from 1; 0: at the section's last

  /// Whether its holes lie one behind the other up to the section's end.
  bool IsStraight() const { return turn_rad_per_m == 0 && !end_radius_m && ends_at_disk == 0; }
};

/// `units` equal units of constant strain; its tendons end at its last disk and pass through earlier
/// sections. The units bend; where switched on they also twist about their backbone, stretch along it and
/// shear.
struct SectionParameters {
  int units = 0;
  double unit_length_m = 0;
  double unit_mass_kg = 0;          // lumped at the unit's end
  double disk_inertia_xx_kgm2 = 0;  // about the disk's x and y
  double disk_inertia_zz_kgm2 = 0;  // about the disk's z
  int units_per_disk = 1;           // a disk ends every so many units; tendons are straight between disks
  double disk_mass_kg = 0;          // of each disk, beside unit_mass_kg
  double youngs_modulus_Pa = 0;
  double core_radius_m = 0;        // backbone core; I = pi r^4 / 4
  double bending_damping_Nms = 0;  // N·m per rad/s, on (du, dv) of each unit
  bool torsion = false;            // strain w [rad], the angle of each unit about its backbone
  bool extension = false;          // strain e, each unit's change of length over unit_length_m
  bool shear = false;  // strains sx, sy, the sideways motion of each unit's end over unit_length_m
  std::optional<double> poissons_ratio{};  // of the backbone
  // Without them those of a round rod of E and Poisson's ratio.
  std::optional<double> torsional_stiffness_Nm2{};  // G J
  std::optional<double> axial_stiffness_N{};        // E A
  std::optional<double> shear_stiffness_N{};        // k G A
  double torsional_damping_Nms = 0;                 // N·m per rad/s, on dw of each unit
  double axial_damping_Nspm = 0;                    // N per m/s, on each unit's change of length
  double shear_damping_Nspm = 0;                    // N per m/s, on each unit's sideways motion
  double rest_torsion_rad_per_m = 0;                // twist in which the backbone is free of stress
  double rest_extension = 0;                        // extension in which it is
  std::vector<TendonRoute> tendons;                 // at least 1

  /// Bending stiffness of one unit, EI / l [N·m/rad].
  double UnitStiffness() const;
  /// Torsional stiffness of one unit, GJ / l [N·m/rad]. Needs torsional_stiffness_Nm2 or poissons_ratio.
  double UnitTorsionalStiffness() const;
  /// Axial stiffness of one unit, EA l [N·m]: the energy is half of it times e².
  double UnitAxialStiffness() const;
  /// Stiffness of one unit sideways [N·m]: the energy is half of it times sx² + sy². Shear in series with the
  /// bending that one constant bend leaves out, l² / (12 EI) (MacNeal, 1978). Needs shear_stiffness_N or
  /// poissons_ratio.
  double UnitShearStiffness() const;
  bool EndsAtDisk(int unit_of_section) const { return (unit_of_section + 1) % units_per_disk == 0; }
  /// Mass lumped at the end of a unit (0-based within the section) and its inertia there: the disk's, or that
  /// of the unit's piece of backbone, a round rod, where there is no disk.
  double MassAt(int unit_of_section) const;
  double InertiaXxAt(int unit_of_section) const;
  double InertiaZzAt(int unit_of_section) const;
};

/// What one unit has that its section's numbers do not say.
struct UnitDeviation {
  int unit = 0;                // along the whole robot, from 1
  double stiffness_scale = 1;  // of the bending stiffness EI / l
  double rest_u_rad = 0;       // bend (u, v) in which the backbone is free of stress
  double rest_v_rad = 0;
};

struct BodyParameters {
  std::vector<SectionParameters> sections;      // 1..kMaxSections, base first
  Eigen::Vector3d gravity_W_mps2{0, 0, -9.81};  // in F_0; the straight robot points along +z of F_0
  double tip_payload_kg = 0;                    // point mass at the centre of the last disk
  Eigen::Vector3d tip_force_W_N{0, 0, 0};       // constant in F_0, at the centre of the last disk
  double twist_rad_per_m = 0;  // a disk's holes are turned about its z by this times its arc length
  std::vector<UnitDeviation> unit_deviations;  // at most one a unit

  int units() const;
  int disks() const;
  int tendons() const;
  double length_m() const;
  /// Distance of the outermost tendon hole from the axis.
  double largest_hole_m() const;
  double mass_kg() const;  // with the payload
  /// Whether the units only bend, one a disk: the body of a controller.
  bool BendsOnly() const;
  bool HasStraightRoutes() const;
  /// Route of a tendon (0-based over the sections), and its hole at an arc length in the axes of a disk
  /// there.
  const TendonRoute& RouteOf(int tendon) const;
  Eigen::Vector3d HoleOf(int tendon, double arc_m) const;
  /// One past the last disk (0-based over the sections) of a tendon, and the arc length from the base to a
  /// disk.
  int EndDiskOf(int tendon) const;
  double ArcTo(int disk) const;
  /// The deviation of unit 1..units(), entered as none where there is none yet.
  UnitDeviation& DeviationOf(int unit);
};

struct MotorParameters {
  double torque_constant_NmpA = 0;
  double nominal_current_A = 0;
  double rotor_inertia_kgm2 = 0;
  double coulomb_friction_Nm = 0;  // at the motor shaft
  double coulomb_angle_rad = 0;    // Dahl pre-sliding angle: zeta' = (w - |w| zeta) / angle
  double coulomb_damping_Nms = 0;  // micro-damping on zeta' (torque = coulomb * zeta + this * zeta')
  double viscous_friction_Nms = 0;
  double torque_lag_s = 0;  // first-order torque loop
  double torque_scale = 1;  // real shaft torque over current x torque_constant_NmpA
  bool operator==(const MotorParameters&) const = default;
};

struct DriveParameters {
  double rated_torque_Nm = 0;               // object 0x6076; torque on the bus is per mille of it
  double current_limit_A = 0;               // object 0x3001:02
  int encoder_counts_per_turn = 0;          // of the motor shaft, as 0x6064 counts them
  double actual_torque_noise_permille = 0;  // rms, of the reported actual torque
  bool operator==(const DriveParameters&) const = default;
};

struct GearParameters {
  double ratio = 0;                           // motor turns per spool turn
  double efficiency = 0;                      // driving; 1/efficiency when back-driven
  std::vector<double> presliding_yields_rad;  // stop operators of the motor angle that switch the direction
  bool operator==(const GearParameters&) const = default;
};

struct SpoolParameters {
  double radius_m = 0;
  bool operator==(const SpoolParameters&) const = default;
};

struct TendonParameters {
  double stiffness_Npm = 0;  // of the whole tendon, spool to end
  double damping_Nspm = 0;
  double free_length_m = 0;  // from spool to the robot's base
};

enum class CapstanLaw {
  kCumulative,  // power law between cumulative friction and normal force (the paper)
  kLocal,       // power law between their densities
  kClassic,     // exp(alpha * wrap)
};

/// One guide pulley (or sheath bend) between spool and base.
struct PulleyParameters {
  CapstanLaw law = CapstanLaw::kCumulative;
  double wrap_rad = 0;
  double radius_ratio = 0;     // rho = pulley radius / tendon radius
  double alpha = 0;            // friction coefficient, N^(1-n)
  double exponent = 1;         // n, 0 < n <= 1
  double entry_angle_rad = 0;  // phi_1
};

struct TransmissionParameters {
  std::vector<PulleyParameters> pulleys;  // from the base (low-tension side under pull) towards the motor
  double presliding_m = 0;                // sliding displacement over which friction builds up
  double low_tension_N = 0.05;            // below: F continued by the constant ratio F(low)/low
  /// Load-independent friction of the pulleys, on the robot's side: T_base = F^-1(T_motor) - this when the
  /// motor pulls, F(T_motor) + this when it pays out.
  double coulomb_N = 0;
};

enum class LoadCellPlace { kNone, kMotorSide, kRobotSide };

struct LoadCellParameters {
  LoadCellPlace place = LoadCellPlace::kNone;
  double gain_VpN = 0;
  double resolution_V = 0;  // one step of the drive's analog input
  double noise_N = 0;       // rms
  double offset_N = 0;      // reading = gain x (tension + offset)
};

struct TrackerParameters {
  double rate_Hz = 0;
  double position_noise_m = 0;       // rms per axis
  double orientation_noise_rad = 0;  // rms per axis of the rotation vector
  double delay_s = 0;                // from the measurement to the time stamp of its reading
};

/// Everything between one drive and one tendon's entry into the robot.
struct TendonDriveParameters {
  MotorParameters motor;
  DriveParameters drive;
  GearParameters gear;
  SpoolParameters spool;
  TendonParameters tendon;
  TransmissionParameters transmission;
  LoadCellParameters load_cell;
  int node_id = 0;  // CANopen node of the drive, 1..127

  /// Tendon pull per motor angle [m/rad].
  double SpoolTravelPerMotorRad() const { return spool.radius_m / gear.ratio; }
};

struct LimitParameters {
  double min_tension_N = 0;  // at the base: pretension and the allocation's lower bound
  double max_tension_base_N = 0;
  double max_tension_motor_N = 0;
  double max_bending_rad = 0;  // |(us, vs)| of each section
};

/// Two opposite tendons of one section on one motor, whose spool winds up the first where it pays out the
/// second. Motor, drive, gear, spool and node are those of the first.
struct TendonPair {
  int first = 0, second = 0;  // 0-based over the sections
  double pretension_N = 0;    // of both, at the spool, on the straight robot while the motor does not pull
};

struct ActuationParameters {
  std::vector<TendonDriveParameters> tendons;  // one a tendon, in tendon order
  std::vector<TendonPair> pairs;               // of tendons in none a motor each
  std::optional<TrackerParameters> tracker;

  /// The pair of a tendon (0-based); null: it has a motor of its own.
  const TendonPair* PairOf(int tendon) const;
  /// Whether a tendon (0-based) has a drive: the second of a pair has none.
  bool HasDrive(int tendon) const;
  int drives() const;
  /// The drive (0-based, in tendon order) that pulls a tendon (0-based).
  int DriveOf(int tendon) const;
  /// By drive the tendon (0-based) that it pulls, of a pair the first.
  std::vector<int> DrivenTendons() const;
};

/// An effect that this robot has beyond the nominal model (the list `effects` of a robot file): by name, with
/// its parameters. What it means is the simulator's business (sim/effects.h); a controller does not use it.
struct EffectSetting {
  std::string name;                                    // "backlash"
  std::string where = "all";                           // all, tendon:j, unit:i or section:k, from 1
  std::vector<std::pair<std::string, double>> values;  // by parameter, SI
  bool operator==(const EffectSetting&) const = default;
};

struct RobotParameters {
  std::string name;
  BodyParameters body;
  LimitParameters limits;
  std::optional<ActuationParameters> actuation;  // absent: a body alone, good for `tendril model`
  std::vector<EffectSetting> effects;
  /// How well numbers are known, by key as in error messages ("body.sections[1].youngs_modulus_Pa"); only
  /// what the file says. A tendon's own ("actuation.per_tendon.2.motor.torque_constant_NmpA") goes before
  /// that of all tendons ("actuation.motor.torque_constant_NmpA"). No part of what the robot is.
  std::map<std::string, Uncertainty> uncertain;

  /// Tension of a tendon (0-based) of the straight robot at rest, friction aside: limits.min_tension_N, or
  /// the pretension of its pair.
  double RestTension_N(int tendon) const;
};

}  // namespace tendril
