// The controller's state from one cycle to the next, as bytes and back: each stage lists its state once, and
// the same list measures, saves and loads. Knows nothing of what the values mean.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>

#include "tendril/model/stop_operator.h"

namespace tendril::control {

class StateArchive {
 public:
  /// Counts bytes only.
  StateArchive() = default;
  static StateArchive Saver(std::span<std::byte> to) { return StateArchive(to.data(), nullptr, to.size()); }
  static StateArchive Loader(std::span<const std::byte> from) {
    return StateArchive(nullptr, from.data(), from.size());
  }

  /// Bytes passed so far.
  std::size_t bytes() const noexcept { return at_; }
  /// False when there were too few bytes or when a loaded value cannot be one of this controller's.
  bool ok() const noexcept { return ok_; }
  void Require(bool true_of_what_was_loaded) noexcept {
    if (loading()) ok_ = ok_ && true_of_what_was_loaded;
  }

  template <class T>
  requires std::is_arithmetic_v<T>
  void Value(T& value) noexcept {
    if constexpr (std::is_same_v<T, bool>) {
      std::uint8_t byte = value ? 1 : 0;
      Raw(&byte, sizeof byte);
      if (loading()) value = byte != 0;
    } else {
      Raw(&value, sizeof value);
    }
  }
  /// Loaded values beyond `last` are refused.
  template <class E>
  requires std::is_enum_v<E>
  void Choice(E& value, E last) noexcept {
    auto number = static_cast<std::underlying_type_t<E>>(value);
    Value(number);
    Require(number <= static_cast<std::underlying_type_t<E>>(last));
    if (loading() && ok_) value = static_cast<E>(number);
  }
  /// Always takes the space of the greatest size; `sizes` are those accepted on loading.
  template <int kMax>
  void Vector(Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMax, 1>& v,
              std::initializer_list<Eigen::Index> sizes) noexcept {
    std::array<double, kMax> values{};
    auto size = static_cast<std::int32_t>(v.size());
    std::memcpy(values.data(), v.data(), static_cast<std::size_t>(size) * sizeof(double));
    Value(size);
    Raw(values.data(), sizeof values);
    if (!loading()) return;
    bool known = false;
    for (const Eigen::Index s : sizes) known = known || s == size;
    Require(known);
    if (!ok_) return;
    v.resize(size);
    std::memcpy(v.data(), values.data(), static_cast<std::size_t>(size) * sizeof(double));
  }
  void Vector(Eigen::Vector3d& v) noexcept { Raw(v.data(), 3 * sizeof(double)); }
  /// The yields are parameters: loaded ones must equal this controller's.
  template <int kCount>
  void Operators(model::StopOperators<kCount>& operators) noexcept {
    using Stops = model::StopOperators<kCount>;
    static_assert(std::is_trivially_copyable_v<Stops>);
    Stops loaded = operators;
    Raw(&loaded, sizeof loaded);
    if (!loading()) return;
    Stops here = operators, there = loaded;
    here.Reset(0);
    there.Reset(0);
    Require(std::memcmp(&here, &there, sizeof here) == 0 && !std::isnan(loaded.Peek(0)));
    if (ok_) operators = loaded;
  }
  /// The angle is a parameter, like the yields.
  void Dahl(model::DahlState& dahl) noexcept {
    static_assert(std::is_trivially_copyable_v<model::DahlState>);
    model::DahlState loaded = dahl;
    Raw(&loaded, sizeof loaded);
    if (!loading()) return;
    model::DahlState here = dahl, there = loaded;
    here.Reset(0);
    there.Reset(0);
    Require(std::memcmp(&here, &there, sizeof here) == 0 && std::isfinite(loaded.Peek(0)));
    if (ok_) dahl = loaded;
  }

 private:
  StateArchive(std::byte* to, const std::byte* from, std::size_t size) : to_(to), from_(from), size_(size) {}
  bool loading() const noexcept { return from_ != nullptr; }
  void Raw(void* data, std::size_t n) noexcept {
    if (to_ != nullptr || from_ != nullptr) {
      ok_ = ok_ && n <= size_ - at_;
      if (!ok_) return;
      if (to_ != nullptr) {
        std::memcpy(to_ + at_, data, n);
      } else {
        std::memcpy(data, from_ + at_, n);
      }
    }
    at_ += n;
  }

  std::byte* to_ = nullptr;
  const std::byte* from_ = nullptr;
  std::size_t size_ = 0, at_ = 0;
  bool ok_ = true;
};

}  // namespace tendril::control
