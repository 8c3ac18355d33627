#include "body_motion.h"

#include <cmath>

namespace tendril::qi2021 {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using model::Body;

model::TensionProfile Constant(const VectorXd& tension_N, double until_s) {
  model::TensionProfile p{VectorXd(2), MatrixXd(tension_N.size(), 2)};
  p.time_s << 0, until_s;
  p.tension_N << tension_N, tension_N;
  return p;
}

VectorXd Bent(const Body& body, double theta_rad, double beta_rad) {
  VectorXd q(body.dof());
  for (int i = 0; i < body.units(); ++i) {
    q.segment<2>(2 * i) << theta_rad * std::cos(beta_rad), theta_rad * std::sin(beta_rad);
  }
  return q;
}

std::vector<std::string> UnitColumns(const Body& body) {
  return io::Columns({"t_s"}, io::Numbered("u", body.units()), io::Numbered("v", body.units()));
}

void PutState(Series& series, double t_s, const VectorXd& q) {
  series.row().Put(t_s);
  for (int part = 0; part < 2; ++part) {
    for (Eigen::Index i = part; i < q.size(); i += 2) series.row().Put(q[i]);
  }
  series.row().EndRow();
}

double TotalEnergy(const Body& body, const VectorXd& tension_N, const VectorXd& q, const VectorXd& dq,
                   Body::Workspace& workspace) {
  VectorXd length_m(body.tendons());
  body.TendonLengths(q, length_m);
  return body.EnergyOf(q, dq, workspace).total() + tension_N.dot(length_m);
}

BodyParameters Placed(BodyParameters p, const Placement& placement) {
  p.gravity_W_mps2 = p.gravity_W_mps2.norm() * placement.gravity_direction;
  return p;
}

}  // namespace tendril::qi2021
