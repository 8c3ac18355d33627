#include "tendril/io/send_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "tendril/core/clock.h"
#include "tendril/core/status.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::io {
namespace {

using State = tendril_lcm::state_t;

constexpr TimeNs kLeastForAnswer_ns = 500 * kNsPerMs;
// Of a command that is taken the answer comes sooner, also from a busy machine.
constexpr TimeNs kSureOfNone_ns = 2 * kNsPerS;
constexpr int kHandle_ms = 20;
// UDP may lose a command, as where a busy machine does not empty the daemon's queue in time.
constexpr TimeNs kRepeat_ns = 200 * kNsPerMs;

TimeNs ToNs(double seconds) { return static_cast<TimeNs>(seconds * static_cast<double>(kNsPerS)); }

bool Is(const Command& command, ModeRequest request) {
  return command.kind == CommandKind::kMode && command.mode == request;
}

// Stopping twice is stopping once. Any other command may be out of date when it comes a second time: an arm
// after another operator's disarm.
bool MayRepeat(const Command& command) {
  return Is(command, ModeRequest::kDisarm) || Is(command, ModeRequest::kHold);
}

// What waiting does not mend.
bool NeedsAHand(Status reason) {
  return reason == Status::kDriveHasFault || reason == Status::kOtherDevice ||
         reason == Status::kDriveMisconfigured || reason == Status::kNodeIdTwice;
}

// An arm that comes when it is done already, or about to be, is as good as the first.
bool ArmedAlready(const State& s) {
  return s.command_status == static_cast<std::int16_t>(Status::kCommandWrongMode) &&
         (s.mode == State::MODE_ARMED || s.mode == State::MODE_PRETENSION || s.mode == State::MODE_RUNNING);
}

// Targets are taken once pretension is reached.
bool OnItsWay(const State& s) { return s.mode == State::MODE_ARMED || s.mode == State::MODE_PRETENSION; }

std::string WithRemedy(Status reason) {
  return fmt::format("{} ({}); {}", StatusText(reason), static_cast<int>(reason), StatusRemedy(reason));
}

// Reports what is waited for, once, when it is not there soon.
class Waiting {
 public:
  explicit Waiting(const std::function<void(const std::string&)>& tell) : tell_(tell) {}
  void For(const std::string& what, TimeNs tell_after_ns) {
    if (what == told_ || clock_.Now() < since_ns_ + tell_after_ns) return;
    told_ = what;
    tell_(what);
  }

 private:
  const std::function<void(const std::string&)>& tell_;
  MonotonicClock clock_;
  TimeNs since_ns_ = clock_.Now();
  std::string told_;
};

class Conversation {
 public:
  explicit Conversation(const CommandCall& call)
      : call_(call), command_(call.command), client_(call.url, call.channel_prefix, call.key) {
    client_.OnState([this](const State& state) { Hear(state); });
  }

  // A robot whose daemon or drives are still starting is armed when they are ready. A drive in fault will not
  // be without its operator.
  void AwaitDrives(const std::function<void(const std::string&)>& tell) {
    // A daemon that waits itself tells so once a second.
    constexpr TimeNs kTellAfter_ns = 300 * kNsPerMs, kTellNobodyAfter_ns = 1500 * kNsPerMs;
    const TimeNs end_ns = clock_.Now() + ToNs(call_.timeout_s);
    Waiting waiting(tell);
    Status reason = Status::kOk;
    while (clock_.Now() < end_ns) {
      Handle();
      if (latest_.utime == 0) {
        const bool waits = !client_.waits().empty();
        waiting.For(fmt::format("a daemon on {} ({}_STATE){}{}", call_.url, call_.channel_prefix,
                                waits ? ", which is " : "", client_.waits()),
                    waits ? 0 : kTellNobodyAfter_ns);
        continue;
      }
      reason = ReasonForMode(latest_);
      if (latest_.mode != State::MODE_DISCONNECTED || NeedsAHand(reason)) return;
      waiting.For(reason == Status::kOk ? "the drives" : fmt::format("the drives: {}", StatusText(reason)),
                  kTellAfter_ns);
    }
    RequireDaemon();
    throw std::runtime_error(
        reason == Status::kOk
            ? fmt::format("the drives did not start within {:g} s; see the daemon's log, or wait longer "
                          "(--timeout)",
                          call_.timeout_s)
            : fmt::format("the drives did not start within {:g} s: {}", call_.timeout_s, WithRemedy(reason)));
  }

  void Publish() {
    RequireNotStopped();
    sent_.push_back(io::Publish(client_, command_, call_.url));
    sent_ns_ = clock_.Now();
  }

  /// The state that answers the command.
  const State& AwaitAnswer(TimeNs end_ns) {
    while (!settled_ && clock_.Now() < end_ns && !Ignored()) {
      Handle();
      if (!answered_ && MayRepeat(command_) && clock_.Now() > sent_ns_ + kRepeat_ns) Publish();
    }
    RequireDaemon();
    if (!answered_ && !client_.ignored().empty())
      throw std::runtime_error("the daemon did not take the command: " + client_.ignored());
    if (!answered_) {
      throw std::runtime_error(
          fmt::format("the daemon is running but did not receive the command within {:g} s; try again, and "
                      "look in its log for messages that it ignores",
                      call_.timeout_s));
    }
    return answer_;
  }

  /// The state in which targets are taken.
  const State& AwaitRunning(TimeNs end_ns) {
    while (OnItsWay(latest_) && clock_.Now() < end_ns) Handle();
    if (latest_.mode == State::MODE_RUNNING) return latest_;
    const Status reason = ReasonForMode(latest_);
    throw std::runtime_error(fmt::format(
        "armed, but {} mode {}: {}",
        OnItsWay(latest_) ? fmt::format("after {:g} s still in", call_.timeout_s) : "then", latest_.mode_text,
        reason == Status::kOk ? std::string("see the daemon's log; send arm again") : WithRemedy(reason)));
  }

 private:
  /// The daemon says that it ignores commands, and has not answered this one.
  bool Ignored() const {
    return !answered_ && !client_.ignored().empty() && clock_.Now() > sent_ns_ + kSureOfNone_ns;
  }

  void RequireNotStopped() const {
    if (call_.stop && *call_.stop) throw std::runtime_error("interrupted");
  }

  void Handle() {
    RequireNotStopped();
    client_.Handle(kHandle_ms);
  }

  void Hear(const State& state) {
    latest_ = state;
    // Another command of this process may have a number between two of these.
    if (settled_ || std::find(sent_.begin(), sent_.end(), state.command_sequence) == sent_.end()) return;
    answered_ = true;
    // Drives that a clear starts again take a moment, in which nothing is to be said yet.
    settled_ = !Is(command_, ModeRequest::kClear) || state.command_status != 0 ||
               state.mode != State::MODE_DISCONNECTED;
    answer_ = state;
  }

  void RequireDaemon() const {
    if (latest_.utime != 0) return;
    throw std::runtime_error(NobodyAnswers(call_.url, call_.channel_prefix, call_.timeout_s, client_));
  }

  const CommandCall& call_;
  Command command_;
  Client client_;
  MonotonicClock clock_;
  std::vector<std::int64_t> sent_;  // numbers of this command, once more for each repetition
  TimeNs sent_ns_ = 0;
  bool answered_ = false, settled_ = false;
  State latest_{}, answer_{};
};

}  // namespace

std::string SendCommand(const CommandCall& call, const std::function<void(const std::string&)>& waiting) {
  const bool arm = Is(call.command, ModeRequest::kArm);
  Conversation daemon(call);
  const MonotonicClock clock;
  TimeNs end_ns = clock.Now() + ToNs(call.timeout_s);
  if (arm && call.timeout_s > 0) {
    daemon.AwaitDrives(waiting);
    end_ns = std::max(end_ns, clock.Now() + kLeastForAnswer_ns);
  }
  daemon.Publish();
  if (call.timeout_s == 0) return {};
  const State answer = daemon.AwaitAnswer(end_ns);
  const bool already = arm && ArmedAlready(answer);
  if (answer.command_status != 0 && !already) throw std::runtime_error(RefusedText(answer));
  if (!arm) return AcceptedText(answer);
  const State& running = daemon.AwaitRunning(end_ns);
  return already ? "armed already; mode " + running.mode_text : AcceptedText(running);
}

std::string AcceptedText(const State& state) {
  std::string text = "accepted; mode " + state.mode_text;
  for (const std::int16_t number : state.reported) {
    const auto status = static_cast<Status>(number);
    // That another's targets are refused is no answer to this command.
    if (status != Status::kTwoSenders) text += fmt::format("; {} {}", number, StatusText(status));
  }
  if (state.target_distance_m > 0) {
    text += fmt::format(" ({:.2f} mm away from the requested point)", 1e3 * state.target_distance_m);
  }
  return text;
}

std::string RefusedText(const State& state) {
  std::string more;
  for (const std::int16_t number : state.reported) {
    const auto status = static_cast<Status>(number);
    // That there are two senders is what a target was refused for.
    if (number != state.command_status && status != Status::kTwoSenders)
      more += fmt::format(": {} {}; {}", number, StatusText(status), StatusRemedy(status));
  }
  return fmt::format("{} ({}, mode {}{})", state.command_status_text, state.command_status, state.mode_text,
                     more);
}

}  // namespace tendril::io
