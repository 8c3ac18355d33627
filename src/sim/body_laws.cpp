// The collection of a body's laws: sums of forces and stiffnesses, product of shares. Knows none of the laws.
#include "body_laws.h"

#include "tendril/core/limits.h"

namespace tendril::sim {

BodyLaws& BodyLaws::operator=(const BodyLaws& other) {
  if (this == &other) return *this;
  laws_.clear();
  for (const auto& law : other.laws_) laws_.push_back(law->Clone());
  return *this;
}

void BodyLaws::AddForce(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef dq,
                        double time_s, model::VectorRef force_Nm) const noexcept {
  for (const auto& law : laws_) law->AddForce(body, q, dq, time_s, force_Nm);
}

void BodyLaws::WeighLengths(const model::Body& body, model::ConstVectorRef q,
                            const Eigen::Ref<const Eigen::MatrixXd>& length_jacobian,
                            model::MatrixRef weighted) const noexcept {
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxTendons, kMaxUnits> share(body.tendons(),
                                                                                         body.units());
  share.setOnes();
  for (const auto& law : laws_) law->Share(body, q, share);
  for (int i = 0; i < body.units(); ++i) {
    for (int a = body.coordinate(i); a < body.coordinate(i + 1); ++a)
      weighted.col(a) = length_jacobian.col(a).cwiseProduct(share.col(i));
  }
}

void BodyLaws::AddStiffness(const model::Body& body, model::ConstVectorRef q,
                            model::ConstVectorRef tension_base_N, model::MatrixRef stiffness) const noexcept {
  for (const auto& law : laws_) law->AddStiffness(body, q, tension_base_N, stiffness);
}

void BodyLaws::Commit(const model::Body& body, model::ConstVectorRef q, double time_s) noexcept {
  for (const auto& law : laws_) law->Commit(body, q, time_s);
}

}  // namespace tendril::sim
