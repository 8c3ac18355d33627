// Another daemon that hears the same commands: both would obey one. Knows nothing of how it is heard.
#pragma once

#include <optional>
#include <string>

#include "tendril/core/clock.h"
#include "tendril/core/daemon.h"
#include "tendril/core/status.h"
#include "tendril/io/gateway.h"

namespace tendril::daemon {

class Neighbour {
 public:
  Neighbour(const io::RunInfo& own, const LcmParameters& lcm) : own_(own), lcm_(lcm) {}

  /// A run record on our channels, possibly our own, looped back.
  void Heard(const io::RunInfo& run, TimeNs now_ns);
  bool present() const { return !name_.empty(); }
  /// Where it runs, and the remedy.
  std::string Text() const;

  struct News {
    Status status;
    std::string text;
  };
  /// Once when it appears and once when it has fallen silent.
  std::optional<News> NewsAt(TimeNs now_ns);

 private:
  const io::RunInfo& own_;
  const LcmParameters& lcm_;
  std::string name_;  // empty: none
  bool told_ = false;
  TimeNs heard_ns_ = 0;
};

}  // namespace tendril::daemon
