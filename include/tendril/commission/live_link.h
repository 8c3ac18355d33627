// A running daemon in mode commissioning, over LCM in real time. Knows nothing of the procedure.
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "tendril/commission/commission.h"

namespace tendril::commission {

class LiveLink final : public CommissionLink {
 public:
  /// Waits for the daemon to describe itself; nothing has moved yet. `stop` (may be null) ends every wait.
  /// Throws std::runtime_error with the remedy.
  LiveLink(const std::string& url, const std::string& channel_prefix, const std::atomic<bool>* stop);
  /// Disarms, however it ended: no motor is left under power.
  ~LiveLink() override;
  LiveLink(const LiveLink&) = delete;
  LiveLink& operator=(const LiveLink&) = delete;

  RobotParameters Robot() const;
  DaemonParameters Daemon() const;
  /// Of the drives by node, as published once a second.
  const DriveSerials& serials() const;

  /// Into the mode, until all drives are enabled and pull nothing.
  void Enter(int tendons);
  void Pull(const TendonVector& pull_N) override;
  const CycleRecord& Next() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::commission
