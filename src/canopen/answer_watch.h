// Whether one drive answers each SYNC, or two with the same node id.
// Knows neither frames nor time: SYNCs and answers come in, as they are on the bus.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace tendril::canopen {

class AnswerWatch {
 public:
  using Data = std::array<std::uint8_t, 8>;
  /// `late_syncs`: how many SYNCs an answer may lag; what lags more is a drive given up already.
  explicit AnswerWatch(int late_syncs) : late_syncs_(late_syncs) {}

  void Restart() noexcept {
    due_ = surplus_ = 0;
    any_ = synced_ = false;
  }

  void OnSync() noexcept {
    synced_ = true;
    due_ = std::min(due_ + 1, late_syncs_);
    surplus_ = std::max(surplus_ - kForgottenBySync, 0);
  }

  /// One TPDO. True from when more than one drive must be answering: one drive's answers, late ones too,
  /// never outnumber the SYNCs. A bit-identical frame without a SYNC in between is one received twice.
  bool OnAnswer(const Data& data) noexcept {
    if (any_ && !synced_ && data == last_) return surplus_ >= kCertain;
    any_ = true;
    synced_ = false;
    last_ = data;
    if (due_ > 0) {
      --due_;
    } else {
      surplus_ = std::min(surplus_ + kSurplusAnswer, kCertain);
    }
    return surplus_ >= kCertain;
  }

 private:
  // In halves of an answer. A SYNC that a drive receives twice gives one surplus answer; on a line where that
  // befalls one frame in a hundred, eight within sixteen SYNCs have a chance of 1e-12. Two drives give one
  // each SYNC.
  static constexpr int kSurplusAnswer = 2, kForgottenBySync = 1, kCertain = 16;

  int late_syncs_;
  int due_ = 0;  // SYNCs less answers
  int surplus_ = 0;
  bool any_ = false, synced_ = false;  // an answer since Restart, a SYNC since the last answer
  Data last_{};
};

}  // namespace tendril::canopen
