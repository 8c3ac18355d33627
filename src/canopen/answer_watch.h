// Detects two drives with the same node id by their answers to SYNC. Knows neither frames nor time: SYNCs and
// answers are passed in as they appear on the bus.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace tendril::canopen {

class AnswerWatch {
 public:
  using Data = std::array<std::uint8_t, 8>;
  /// `late_syncs`: how many SYNCs an answer may lag; a drive that lags more has been given up.
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

  /// One TPDO. True once more than one drive must be answering: one drive's answers, including late ones,
  /// never outnumber the SYNCs. A bit-identical frame without a SYNC in between counts as one frame received
  /// twice.
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
  // In halves of an answer. A SYNC received twice by a drive gives one surplus answer; at a duplication rate
  // of one frame in a hundred, eight of them within sixteen SYNCs have a probability of 1e-12. Two drives
  // give one surplus answer per SYNC.
  static constexpr int kSurplusAnswer = 2, kForgottenBySync = 1, kCertain = 16;

  int late_syncs_;
  int due_ = 0;  // SYNCs less answers
  int surplus_ = 0;
  bool any_ = false, synced_ = false;  // an answer since Restart; a SYNC since the last answer
  Data last_{};
};

}  // namespace tendril::canopen
