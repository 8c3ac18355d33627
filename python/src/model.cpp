// The body's equations, row by row. Shapes are checked by the package; what goes wrong in a row is RowError.
#include <fmt/format.h>
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "module.h"
#include "rows.h"
#include "tendril/config/config.h"
#include "tendril/core/robot.h"
#include "tendril/core/tip_unit.h"
#include "tendril/exchange/robot_model.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/coordinate_names.h"
#include "tendril/model/inverse.h"
#include "tendril/model/inverse_equilibrium.h"
#include "tendril/model/loading.h"
#include "tendril/model/open_disks.h"
#include "tendril/model/shape_points.h"
#include "tendril/model/statics.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;

/// A robot's body and what its file allows; the rows that are under way keep it alive.
struct Subject {
  explicit Subject(const RobotParameters& r) : robot(r), body(r.body) {}
  RobotParameters robot;
  Body body;
};
using SubjectPtr = std::shared_ptr<const Subject>;
using RowsPtr = std::shared_ptr<const Rows>;

struct NewWorkspace {
  SubjectPtr of;
  Body::Workspace operator()() const { return Body::Workspace(of->body); }
};

struct NewArcs {
  SubjectPtr of;
  std::unique_ptr<model::ArcTensions> operator()() const {
    return std::make_unique<model::ArcTensions>(of->body, model::TendonPairs(of->robot));
  }
};

/// What is missed counts only where the target was not reached.
double Missed(Status status, double by) { return status == Status::kOk ? 0 : by; }

RowsPtr Keep(Rows rows) { return std::make_shared<const Rows>(std::move(rows)); }
std::shared_ptr<Rows> Table(Index rows, Index columns) { return std::make_shared<Rows>(rows, columns); }

struct Nothing {};

VectorXd OpenShape(const Body& body, const Rows& q, Index i) {
  const VectorXd row = q.row(i);
  if (const std::string why = model::WhyDisksClose(body, row); !why.empty()) throw RowError(i, why);
  return row;
}

VectorXd EquilibriumOf(const Body& body, const Rows& tension_N, Index i, const Vector3d& force_W_N) {
  const model::Equilibrium found = model::SolveStatics(body, tension_N.row(i).transpose(), force_W_N);
  if (const std::string why = model::WhyNoEquilibrium(found); !why.empty()) throw RowError(i, why);
  return found.q;
}

Vector3d ForceOf(const RowsPtr& force_W_N, Index i) {
  return force_W_N ? Vector3d(force_W_N->row(i)) : Vector3d(0, 0, 0);
}

/// One table of `columns`, filled by `fill(i, row, scratch)`.
template <class Make, class Fill>
Rows Filled(Index rows, Index columns, Make make, Fill fill) {
  const auto out = Table(rows, columns);
  EachRow(rows, std::move(make),
          [out, fill = std::move(fill)](Index i, auto& scratch) { fill(i, out->row(i), scratch); });
  return std::move(*out);
}
const auto kNoScratch = [] { return Nothing{}; };

class Model {
 public:
  explicit Model(const RobotParameters& robot) : s_(std::make_shared<const Subject>(robot)) {}

  std::vector<std::string> Coordinates() const { return model::CoordinateNames(s_->body); }

  int DiskCount() const { return s_->body.disks(); }

  Rows Statics(Rows tension_N, std::optional<Rows> tip_force_W_N) const {
    const RowsPtr tension = Keep(std::move(tension_N));
    const RowsPtr force = tip_force_W_N ? Keep(std::move(*tip_force_W_N)) : nullptr;
    return Filled(tension->rows(), s_->body.dof(), kNoScratch,
                  [s = s_, tension, force](Index i, auto row, Nothing&) {
                    row = EquilibriumOf(s->body, *tension, i, ForceOf(force, i)).transpose();
                  });
  }

  Rows Frequencies(Rows tension_N) const {
    const RowsPtr tension = Keep(std::move(tension_N));
    return Filled(tension->rows(), s_->body.dof(), kNoScratch,
                  [s = s_, tension](Index i, auto row, Nothing&) {
                    const VectorXd q = EquilibriumOf(s->body, *tension, i, Vector3d::Zero());
                    const VectorXd f =
                        model::NaturalFrequencies(s->body, q, tension->row(i).transpose(), Vector3d::Zero());
                    if (!(f[0] > 0))
                      throw RowError(i, "no frequencies: the equilibrium is at the edge of buckling");
                    row = f.transpose();
                  });
  }

  Rows ForwardDynamics(Rows q_rows, Rows dq_rows, Rows tension_N) const {
    const RowsPtr q = Keep(std::move(q_rows)), dq = Keep(std::move(dq_rows)),
                  tension = Keep(std::move(tension_N));
    return Filled(q->rows(), s_->body.dof(), NewWorkspace{s_},
                  [s = s_, q, dq, tension](Index i, auto row, auto& scratch) {
                    const VectorXd shape = OpenShape(s->body, *q, i);
                    VectorXd force(s->body.dof()), ddq(s->body.dof());
                    s->body.TendonForce(shape, tension->row(i).transpose(), force);
                    s->body.ForwardDynamics(shape, dq->row(i).transpose(), force, ddq, scratch);
                    if (!ddq.allFinite())
                      throw RowError(i, "the accelerations are not finite: the state has extreme values");
                    row = ddq.transpose();
                  });
  }

  /// Tip position, quaternion w, x, y, z, and straight tendon lengths, side by side.
  Rows ForwardKinematics(Rows q_rows) const {
    const RowsPtr q = Keep(std::move(q_rows));
    return Filled(q->rows(), 7 + s_->body.tendons(), kNoScratch, [s = s_, q](Index i, auto row, Nothing&) {
      const VectorXd shape = OpenShape(s->body, *q, i);
      const model::Pose tip = s->body.TipPose(shape);
      const Eigen::Quaterniond turn = model::UnitQuaternion(tip.R_WA);
      VectorXd length_m(s->body.tendons());
      s->body.TendonLengths(shape, length_m);
      row << tip.p_WA.transpose(), turn.w(), turn.x(), turn.y(), turn.z(), length_m.transpose();
    });
  }

  /// 6 x n a row, row by row.
  Rows Jacobian(Rows q_rows) const {
    const RowsPtr q = Keep(std::move(q_rows));
    return Filled(q->rows(), 6 * s_->body.dof(), kNoScratch, [s = s_, q](Index i, auto row, Nothing&) {
      Eigen::MatrixXd jacobian(6, s->body.dof());
      s->body.TipJacobian(OpenShape(s->body, *q, i), jacobian);
      const Rows by_row = jacobian;
      row = Eigen::Map<const Eigen::RowVectorXd>(by_row.data(), by_row.size());
    });
  }

  /// n x n a row, row by row.
  Rows MassMatrix(Rows q_rows) const {
    const RowsPtr q = Keep(std::move(q_rows));
    return Filled(q->rows(), s_->body.dof() * s_->body.dof(), NewWorkspace{s_},
                  [s = s_, q](Index i, auto row, auto& scratch) {
                    Eigen::MatrixXd mass(s->body.dof(), s->body.dof());
                    s->body.MassMatrix(OpenShape(s->body, *q, i), mass, scratch);
                    const Rows by_row = mass;
                    row = Eigen::Map<const Eigen::RowVectorXd>(by_row.data(), by_row.size());
                  });
  }

  /// Kinetic, elastic, gravity.
  Rows Energy(Rows q_rows, Rows dq_rows) const {
    const RowsPtr q = Keep(std::move(q_rows)), dq = Keep(std::move(dq_rows));
    return Filled(q->rows(), 3, NewWorkspace{s_}, [s = s_, q, dq](Index i, auto row, auto& scratch) {
      const model::Energy e = s->body.EnergyOf(OpenShape(s->body, *q, i), dq->row(i).transpose(), scratch);
      row << e.kinetic, e.elastic, e.gravity;
    });
  }

  /// `points` positions a row along the backbone, 3 each.
  Rows Backbone(Rows q_rows, int points) const {
    const RowsPtr q = Keep(std::move(q_rows));
    return Filled(q->rows(), 3 * points, kNoScratch, [s = s_, q, points](Index i, auto row, Nothing&) {
      const Eigen::Matrix3Xd at = model::BackbonePoints(s->body, OpenShape(s->body, *q, i), points);
      row = Eigen::Map<const Eigen::RowVectorXd>(at.data(), at.size());
    });
  }

  /// Angles of the hinges u, v of each unit, 2N a row.
  Rows HingeAngles(Rows q_rows) const {
    RequireBendingOnly("hinge_angles");
    const RowsPtr q = Keep(std::move(q_rows));
    return Filled(q->rows(), s_->body.dof(), kNoScratch, [q](Index i, auto row, Nothing&) {
      row = exchange::HingeAngles(q->row(i).transpose()).transpose();
    });
  }
  Rows Disks(Rows q_rows) const {
    const RowsPtr q = Keep(std::move(q_rows));
    const Index disks = s_->body.disks() + 1;
    return Filled(q->rows(), 16 * disks, kNoScratch, [s = s_, q](Index i, auto row, Nothing&) {
      Index at = 0;
      for (const model::Pose& disk : model::DiskPoses(s->body, OpenShape(s->body, *q, i))) {
        Eigen::Matrix<double, 4, 4, Eigen::RowMajor> frame = Eigen::Matrix4d::Identity();
        frame.topLeftCorner<3, 3>() = disk.R_WA;
        frame.topRightCorner<3, 1>() = disk.p_WA;
        row.segment(at, 16) = Eigen::Map<const Eigen::RowVectorXd>(frame.data(), 16);
        at += 16;
      }
    });
  }

  /// Holes of every tendon at every disk it passes, M x (D + 1) x 3; NaN beyond its end.
  Rows TendonPoints(Rows q_rows) const {
    const RowsPtr q = Keep(std::move(q_rows));
    const Index each = 3 * (s_->body.disks() + 1);
    return Filled(
        q->rows(), each * s_->body.tendons(), kNoScratch, [s = s_, q, each](Index i, auto row, Nothing&) {
          const VectorXd shape = OpenShape(s->body, *q, i);
          for (int j = 0; j < s->body.tendons(); ++j) {
            const Eigen::Matrix3Xd at = model::TendonHoles(s->body, shape, j);
            row.segment(j * each, each).setConstant(std::nan(""));
            row.segment(j * each, at.size()) = Eigen::Map<const Eigen::RowVectorXd>(at.data(), at.size());
          }
        });
  }

  /// Tensions, then how far the target is missed: as `tendril model inverse` of arcs [N·m of force], or of
  /// equilibria [rad].
  Rows Inverse(Rows bending_rad, std::optional<Rows> rate_rows, std::optional<Rows> acceleration_rows,
               double min_tension_N, bool equilibrium) const {
    RequireBendingOnly("inverse");
    const RowsPtr bending = Keep(std::move(bending_rad));
    const bool moving = rate_rows.has_value();
    const RowsPtr rate = moving ? Keep(std::move(*rate_rows)) : nullptr;
    const RowsPtr acceleration = moving ? Keep(std::move(*acceleration_rows)) : nullptr;
    const auto motion = [moving](const RowsPtr& rows, Index i, Index size) -> VectorXd {
      return moving ? VectorXd(rows->row(i).transpose()) : VectorXd::Zero(size);
    };
    return Filled(
        bending->rows(), s_->body.tendons() + 1, NewArcs{s_},
        [s = s_, bending, rate, acceleration, motion, min_tension_N, moving, equilibrium](Index i, auto row,
                                                                                          auto& arcs) {
          const VectorXd bend = bending->row(i).transpose();
          const VectorXd dbend = motion(rate, i, bend.size()), ddbend = motion(acceleration, i, bend.size());
          VectorXd spread(s->body.dof());
          s->body.SpreadBending(bend, spread);
          if (const std::string why = model::WhyDisksClose(s->body, spread); !why.empty())
            throw RowError(i, why);
          const double most_N = s->robot.limits.max_tension_base_N;
          if (!equilibrium) {
            const auto result = arcs->Move(bend, dbend, ddbend, min_tension_N, most_N);
            row << result.tension_N.transpose(), Missed(result.status, result.residual_Nm);
            return;
          }
          const model::InverseEquilibrium solver(s->body, min_tension_N, most_N,
                                                 model::TendonPairs(s->robot));
          const auto shape = moving ? solver.ForBending(bend, dbend, ddbend) : solver.ForBending(bend);
          if (const std::string why = model::WhyNoShape(shape); !why.empty())
            throw RowError(i, why + "; reduce the target");
          row << shape.tension_N.transpose(), Missed(shape.status, shape.target_error);
        });
  }

  /// Tensions, q, then the distance by which the target is missed [m], as `tendril model inverse-tip`, and 1
  /// where raising the tensions from zero ends there (only asked at rest, else 1).
  Rows InverseTip(Rows tip_m, std::optional<Rows> velocity_rows, std::optional<Rows> acceleration_rows,
                  double min_tension_N) const {
    RequireBendingOnly("inverse_tip");
    const RowsPtr tip = Keep(std::move(tip_m));
    const bool moving = velocity_rows.has_value();
    const RowsPtr velocity = moving ? Keep(std::move(*velocity_rows)) : nullptr;
    const RowsPtr acceleration = moving ? Keep(std::move(*acceleration_rows)) : nullptr;
    return Filled(
        tip->rows(), s_->body.tendons() + s_->body.dof() + 2, kNoScratch,
        [s = s_, tip, velocity, acceleration, min_tension_N, moving](Index i, auto row, Nothing&) {
          const model::InverseEquilibrium solver(s->body, min_tension_N, s->robot.limits.max_tension_base_N,
                                                 model::TendonPairs(s->robot));
          const Vector3d target = tip->row(i).transpose();
          const double most = s->robot.limits.max_bending_rad;
          const auto shape = moving ? solver.ForTip(target, velocity->row(i).transpose(),
                                                    acceleration->row(i).transpose(), most)
                                    : solver.ForTip(target, most);
          if (const std::string why = model::WhyNoShape(shape); !why.empty())
            throw RowError(i, why + AskMillimetres(target, s->robot.body.length_m()) + "; reduce the target");
          const bool loaded = moving || model::LoadingEndsAt(s->body, shape.tension_N, shape.q);
          row << shape.tension_N.transpose(), shape.q.transpose(), Missed(shape.status, shape.target_error),
              loaded ? 1.0 : 0.0;
        });
  }

  /// us, vs a section, then the distance by which the target is missed [m]. Each row's search begins at the
  /// row before.
  Rows InverseKinematics(const Rows& tip_m) const {
    RequireBendingOnly("ik");
    const nb::gil_scoped_release released;
    const model::InverseKinematics ik(s_->body, s_->robot.limits.max_bending_rad);
    Rows out(tip_m.rows(), 2 * s_->body.sections() + 1);
    BendingVector seed = BendingVector::Zero(2 * s_->body.sections());
    for (Index i = 0; i < tip_m.rows(); ++i) {
      const auto solution = ik.Solve(tip_m.row(i).transpose(), seed);
      out.row(i) << solution.us_vs.transpose(), Missed(solution.status, solution.distance_m);
      seed = solution.us_vs;
    }
    return out;
  }

  Rows SpreadBending(Rows us_vs) const {
    Rows q(us_vs.rows(), s_->body.dof());
    VectorXd one(s_->body.dof());
    for (Index i = 0; i < us_vs.rows(); ++i) {
      s_->body.SpreadBending(us_vs.row(i).transpose(), one);
      q.row(i) = one.transpose();
    }
    return q;
  }

 private:
  void RequireBendingOnly(const std::string& method) const {
    config::RequireBendingOnly(s_->robot.body, s_->robot.name, "tendril.Model." + method);
  }

  SubjectPtr s_;
};

double CapstanRatioOf(double alpha, double wrap_rad, double tension_N, std::optional<double> exponent,
                      std::optional<double> radius_ratio, double entry_angle_rad, bool release,
                      const std::string& law, double low_tension_N) {
  PulleyParameters pulley;
  pulley.law = law == "classic" ? CapstanLaw::kClassic
               : law == "local" ? CapstanLaw::kLocal
                                : CapstanLaw::kCumulative;
  pulley.alpha = alpha;
  pulley.wrap_rad = wrap_rad;
  pulley.entry_angle_rad = entry_angle_rad;
  if (exponent) pulley.exponent = *exponent;
  if (radius_ratio) pulley.radius_ratio = *radius_ratio;
  model::ValidatePulley(pulley);
  return model::CapstanRatio(pulley, tension_N, release, low_tension_N);
}

}  // namespace

void AddModel(nb::module_& m) {
  m.def("capstan_ratio", &CapstanRatioOf, nb::arg("alpha"), nb::arg("wrap"), nb::arg("tension"),
        nb::arg("n").none(), nb::arg("rho").none(), nb::arg("phi1"), nb::arg("release"), nb::arg("law"),
        nb::arg("low_tension"));
  nb::class_<Model>(m, "Model")
      .def(nb::init<const RobotParameters&>(), nb::arg("robot"))
      .def_prop_ro("coordinates", &Model::Coordinates)
      .def_prop_ro("disk_count", &Model::DiskCount)
      .def("statics", &Model::Statics, nb::arg("tension"), nb::arg("tip_force").none())
      .def("frequencies", &Model::Frequencies, nb::arg("tension"))
      .def("forward_dynamics", &Model::ForwardDynamics, nb::arg("q"), nb::arg("dq"), nb::arg("tension"))
      .def("fk", &Model::ForwardKinematics, nb::arg("q"))
      .def("jacobian", &Model::Jacobian, nb::arg("q"))
      .def("mass_matrix", &Model::MassMatrix, nb::arg("q"))
      .def("energy", &Model::Energy, nb::arg("q"), nb::arg("dq"))
      .def("backbone", &Model::Backbone, nb::arg("q"), nb::arg("points"))
      .def("hinge_angles", &Model::HingeAngles, nb::arg("q"))
      .def("disks", &Model::Disks, nb::arg("q"))
      .def("tendon_points", &Model::TendonPoints, nb::arg("q"))
      .def("inverse", &Model::Inverse, nb::arg("bending"), nb::arg("rate").none(),
           nb::arg("acceleration").none(), nb::arg("min_tension"), nb::arg("equilibrium"))
      .def("inverse_tip", &Model::InverseTip, nb::arg("tip"), nb::arg("velocity").none(),
           nb::arg("acceleration").none(), nb::arg("min_tension"))
      .def("ik", &Model::InverseKinematics, nb::arg("tip"))
      .def("spread", &Model::SpreadBending, nb::arg("bending"));
}

}  // namespace tendril::python
