// Laws that effects add to the body: extra generalised forces, and the decrease of a tendon's tension from
// disk to disk. Memories are read within a solver's steps and moved at accepted ones. Knows nothing of
// motors, solvers or files.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

#include "tendril/model/body.h"

namespace tendril::sim {

/// One law. A memory, if any, starts relaxed at the straight body; the const functions give the result of a
/// straight motion from the committed shape ("peek"). q, dq: 2N; M tendons, N units.
class BodyLaw {
 public:
  virtual ~BodyLaw() = default;
  virtual std::unique_ptr<BodyLaw> Clone() const = 0;

  /// Adds the law's generalised force on (u, v) of every unit [N·m].
  virtual void AddForce(const model::Body&, model::ConstVectorRef /*q*/, model::ConstVectorRef /*dq*/,
                        double /*time_s*/, model::VectorRef /*force_Nm*/) const noexcept {}
  /// Multiplies share(j, i), M x N, by the tension of tendon j in unit i over its tension at the base. A
  /// share does not depend on the tensions. Spans beyond a tendon's end are ignored.
  virtual void Share(const model::Body&, model::ConstVectorRef /*q*/,
                     model::MatrixRef /*share*/) const noexcept {}
  /// Adds -d(force)/dq, 2N x 2N [N·m/rad], of both kinds of force, at these base tensions; not symmetric in
  /// general. For implicit solvers: it affects their speed, not their result.
  virtual void AddStiffness(const model::Body&, model::ConstVectorRef /*q*/,
                            model::ConstVectorRef /*tension_N*/,
                            model::MatrixRef /*stiffness*/) const noexcept {}
  /// The body has moved straight to q: moves the memory there.
  virtual void Commit(const model::Body&, model::ConstVectorRef /*q*/, double /*time_s*/) noexcept {}
};

/// All laws of one body; copying copies the memories. Not thread-safe: one copy per thread.
class BodyLaws {
 public:
  BodyLaws() = default;
  BodyLaws(const BodyLaws& other) { *this = other; }
  BodyLaws& operator=(const BodyLaws& other);
  BodyLaws(BodyLaws&&) noexcept = default;
  BodyLaws& operator=(BodyLaws&&) noexcept = default;
  ~BodyLaws() = default;

  void Add(std::unique_ptr<BodyLaw> law) { laws_.push_back(std::move(law)); }
  /// No laws: the nominal body, to be computed without the functions below.
  bool empty() const noexcept { return laws_.empty(); }

  /// Adds the laws' generalised forces (without those of the tendons) [N·m].
  void AddForce(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef dq, double time_s,
                model::VectorRef force_Nm) const noexcept;
  /// M x 2N: the rows of dL/dq (Body::TendonLengthJacobian at q), each unit's two columns times the share of
  /// the base tension that arrives there. The tendons' generalised force is -weighted^T tension_base: linear
  /// in the base tensions. Without friction along the disks `weighted` is dL/dq itself.
  void WeighLengths(const model::Body& body, model::ConstVectorRef q,
                    const Eigen::Ref<const Eigen::MatrixXd>& length_jacobian,
                    model::MatrixRef weighted) const noexcept;
  /// Adds -d(force)/dq of AddForce, and of the tendons' force through the change of the shares, to a tangent
  /// stiffness (2N x 2N); a hint, see BodyLaw::AddStiffness. With uneven shares, Body::TangentStiffness at
  /// the base tensions remains the other part of the hint.
  void AddStiffness(const model::Body& body, model::ConstVectorRef q, model::ConstVectorRef tension_base_N,
                    model::MatrixRef stiffness) const noexcept;
  /// Moves every memory to the shape of an accepted step.
  void Commit(const model::Body& body, model::ConstVectorRef q, double time_s) noexcept;

 private:
  std::vector<std::unique_ptr<BodyLaw>> laws_;
};

}  // namespace tendril::sim
