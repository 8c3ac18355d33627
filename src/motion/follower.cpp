#include "tendril/motion/follower.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <lcm/lcm-cpp.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"
#include "tendril/motion/path.h"
#include "tendril/motion/sample_stream.h"

namespace tendril::motion {
namespace {

constexpr TimeNs kCommandPeriod_ns = 10 * kNsPerMs;
// Long enough for a late scheduler, short enough that a dead stream stops the robot soon.
constexpr double kValidFor_s = 0.1;
// Its validity counts from a target's arrival.
constexpr TimeNs kLetGo_ns = 20 * kNsPerMs;
// Of the daemon's time, how long after the next state was due it is taken to stand still.
constexpr TimeNs kOverdueState_ns = 50 * kNsPerMs;
constexpr TimeNs kAnswer_ns = 3 * kNsPerS, kSilence_ns = kNsPerS, kArmingAtMost_ns = 10 * kNsPerS;
// Further from the robot's reach than this, the motion was made for another robot.
constexpr double kOutOfReach_m = 1e-3;
// Closer than this to the motion's first target, the robot's reference counts as there.
constexpr double kArrivedBending_rad = 1e-4;
constexpr std::int64_t kMostRefused = 20;
// Of the daemon's own speed: as fast the first samples are joined.
constexpr double kJoinAt = 0.4;
constexpr TimeNs kStillBefore_ns = 500 * kNsPerMs, kApproachAtMost_ns = 30 * kNsPerS;

TimeNs ToNs(double seconds) { return static_cast<TimeNs>(seconds * 1e9); }

/// `file` in place of the robot that the daemon has; it must be of the same build.
void TakeRobot(const std::string& file, Subject& subject) {
  const RobotParameters own = config::LoadRobot(file);
  const BodyParameters &a = own.body, &b = subject.robot.body;
  bool same = a.sections.size() == b.sections.size() && std::abs(a.length_m() / b.length_m() - 1) < 1e-6;
  const auto length_m = [](const SectionParameters& section) {
    return section.units * section.unit_length_m;
  };
  for (std::size_t k = 0; same && k < a.sections.size(); ++k)
    same = std::abs(length_m(a.sections[k]) - length_m(b.sections[k])) < 1e-9;
  if (!same) {
    throw std::runtime_error(
        fmt::format("{} is not the daemon's robot: {} section{} and {:.1f} mm, the daemon's '{}' has {} and "
                    "{:.1f} mm; name its "
                    "file, or leave --robot out",
                    file, a.sections.size(), a.sections.size() == 1 ? "" : "s", 1e3 * a.length_m(),
                    subject.robot.name, b.sections.size(), 1e3 * b.length_m()));
  }
  subject.robot = own;
}

struct Errors {
  double sum2 = 0, largest = 0;
  int count = 0;
  void Add(double error) {
    sum2 += error * error;
    largest = std::max(largest, error);
    ++count;
  }
  std::string Text() const {
    return fmt::format("rms {:.3f} mm, largest {:.3f} mm", count ? 1e3 * std::sqrt(sum2 / count) : 0.0,
                       1e3 * largest);
  }
};

}  // namespace

double Subject::LeadS() const {
  return ToSeconds(control::Controller(robot, daemon.controller, daemon.bus.cycle_ns).look_ahead_ns());
}

struct Follower::Impl {
 public:
  explicit Impl(const FollowSetup& setup)
      : setup_(setup),
        lcm_(io::OpenLcm(setup.lcm_url)),
        client_(lcm_.get(), setup.channel_prefix, setup.key) {
    client_.OnState([this](const tendril_lcm::state_t& s) {
      state_ = s;
      heard_ns_ = clock_.Now();
      daemon_ahead_ns_[states_++ % daemon_ahead_ns_.size()] = s.utime * kNsPerUs - heard_ns_;
      const bool own = io::SenderOf(s.command_sequence) == io::SenderOfProcess();
      // Another client of this process may have sent earlier ones.
      answers_ = answers_ || (own && first_sequence_ && s.command_sequence >= *first_sequence_);
      if (own && s.command_status == static_cast<std::int16_t>(Status::kAnotherSender))
        another_leads_ = s.command_status_text;
    });
    lcm_->subscribe(io::ChannelName(setup.channel_prefix, "RUN"), &Impl::TakeRun, this);
    const TimeNs asked_ns = clock_.Now();
    while (!Heard() && clock_.Now() - asked_ns < kAnswer_ns && !Stopped()) client_.Handle(20);
    if (!Heard() && !client_.waits().empty())
      throw std::runtime_error(io::NobodyAnswers(setup_.lcm_url, setup_.channel_prefix, 3, client_));
    if (!Heard()) {
      throw std::runtime_error(fmt::format(
          "no daemon answers on {} ({}_STATE, {}_RUN) within 3 s; is tendrild running, of this version "
          "and with the same --lcm and --prefix?",
          setup_.lcm_url, setup_.channel_prefix, setup_.channel_prefix));
    }
    subject_.robot = config::ParseRobot(run_.robot_yaml, "the daemon's robot");
    subject_.daemon = config::ParseDaemon(run_.daemon_yaml, "the daemon's file");
    lead_s_ = subject_.LeadS();
    if (subject_.daemon.controller.trajectory.look_ahead) extrapolates_s_ = lead_s_;
    if (!setup_.robot_file.empty()) TakeRobot(setup_.robot_file, subject_);
  }

  const Subject& subject() const { return subject_; }

  void Follow(const Motion& motion) {
    AwaitRunning();
    Tell("{}", motion.description());
    Approach(motion.Start());
    Stream(motion);
    LetGo();
  }

  /// Commands of another program, on channels of its own, as one even motion.
  void FollowSamples(const std::string& from, double delay_s, bool nearest) {
    delay_s_ = delay_s;
    AwaitRunning();
    TipSolver solver(subject_.robot, nearest);
    solver_ = &solver;
    stream_.emplace(ToNs(delay_s_));
    lcm_->subscribe(io::ChannelName(from, "COMMAND_TIP"), &Impl::TakeSample<tendril_lcm::command_tip_t>,
                    this);
    lcm_->subscribe(io::ChannelName(from, "COMMAND_BENDING"),
                    &Impl::TakeSample<tendril_lcm::command_bending_t>, this);
    Tell("waiting for {0}_COMMAND_TIP or {0}_COMMAND_BENDING on {1}", from, setup_.lcm_url);
    while (stream_->empty()) {
      client_.Handle(20);
      CheckRunning();
    }
    Join();
    Tell("there; following {:g} s behind the samples", delay_s_);
    TimeNs next_ns = clock_.Now();
    while (!stream_->Expired(clock_.Now())) {
      const SampleStream::Point at = stream_->At(clock_.Now());
      Send(Bend(at.value, at.rate));
      SleepToNext(next_ns);
      CheckRunning();
    }
    Tell("{} samples followed; the last one expired: the robot rests on it", samples_);
    LetGo();
  }

 private:
  template <class... Values>
  void Tell(fmt::format_string<Values...> form, Values&&... values) const {
    setup_.tell(fmt::format(form, std::forward<Values>(values)...));
  }
  bool Stopped() const { return !setup_.stopped_by().empty(); }

  static Command Bend(const Eigen::VectorXd& bending_rad, const Eigen::VectorXd& rate_radps) {
    Command target;
    target.kind = CommandKind::kBending;
    target.bending_rad = bending_rad;
    target.bending_rate_radps = rate_radps;
    return target;
  }

  // At the daemon's own speed towards the latest sample, until it is near enough to join in at that speed.
  void Join() {
    const double near_rad =
        kJoinAt * subject_.daemon.controller.trajectory.default_speed_radps * std::min(delay_s_, 0.5);
    const TimeNs start_ns = clock_.Now();
    TimeNs next_ns = start_ns;
    for (;;) {
      const Eigen::VectorXd latest = stream_->latest();
      Send(Bend(latest, Eigen::VectorXd::Zero(latest.size())));
      SleepToNext(next_ns);
      CheckRunning();
      // What the daemon's smoothing has taken in already, and will put out.
      const Eigen::Map<const Eigen::VectorXd> desired(state_.bending_desired_rad.data(), latest.size()),
          rate(state_.bending_rate_desired_radps.data(), latest.size());
      const Eigen::VectorXd from = desired + lead_s_ * rate;
      if ((stream_->latest() - from).norm() <= near_rad) {
        stream_.emplace(ToNs(delay_s_));
        stream_->Add(clock_.Now() - 2 * ToNs(delay_s_), from, kApproachAtMost_ns);
        return;
      }
      if (clock_.Now() - start_ns > kApproachAtMost_ns) {
        throw std::runtime_error(
            "the samples were not reached within 30 s: they move faster than the daemon's "
            "default_speed_radps; the robot holds the last target");
      }
    }
  }

  bool Heard() const { return states_ > 0 && !run_.robot_yaml.empty(); }
  bool Arming() const {
    return !Stopped() && (state_.mode == tendril_lcm::state_t::MODE_ARMED ||
                          state_.mode == tendril_lcm::state_t::MODE_PRETENSION);
  }
  void AwaitRunning() {
    const TimeNs asked_ns = clock_.Now();
    while (Arming() && clock_.Now() - asked_ns < kArmingAtMost_ns) client_.Handle(20);
    accepted_ = state_.commands_accepted;
    refused_ = state_.commands_refused;
    CheckRunning();
  }

  void TakeRun(const lcm::ReceiveBuffer* buffer, const std::string&) {
    tendril_lcm::run_t run;
    if (io::Decode(buffer->data, static_cast<int>(buffer->data_size), run)) run_ = run;
  }

  // What is wrong with a sample is said outside of LCM's dispatch.
  template <class Message>
  void TakeSample(const lcm::ReceiveBuffer* buffer, const std::string& channel) {
    Message message;
    if (!io::Decode(buffer->data, static_cast<int>(buffer->data_size), message)) return;
    Command command;
    std::string wrong = io::FromMessage(message, command);
    try {
      if (wrong.empty() && last_sequence_ &&
          static_cast<std::int32_t>(command.sequence - *last_sequence_) <= 0)
        return;  // overtaken on its way, or twice
      last_sequence_ = command.sequence;
      if (wrong.empty()) AddSample(command);
    } catch (const std::exception& e) {
      wrong = e.what();
    }
    if (!wrong.empty()) wrong_sample_ = fmt::format("{}, sequence {}: {}", channel, message.sequence, wrong);
  }
  void AddSample(const Command& c) {
    if (c.valid_for_ns <= 0)
      throw std::runtime_error("valid_for_s is not positive; give how long a sample is valid");
    Eigen::VectorXd bending = c.bending_rad;
    const Eigen::Index k2 = 2 * static_cast<Eigen::Index>(subject_.robot.body.sections.size());
    if (c.kind == CommandKind::kTip) {
      if (!c.tip_W_m.allFinite()) throw std::runtime_error("tip_W_m is not finite; send numbers");
      bending = solver_->Solve(c.tip_W_m, "tip_W_m");
    } else if (bending.size() != k2 || !bending.allFinite()) {
      throw std::runtime_error(fmt::format("bending_rad needs {} finite numbers, two a section", k2));
    }
    for (Eigen::Index k = 0; k < k2; k += 2) {
      if (bending.segment<2>(k).norm() > subject_.robot.limits.max_bending_rad * (1 + 1e-9)) {
        throw std::runtime_error(fmt::format("section {} is bent by {:.3f} rad; accepted: up to {:g}",
                                             k / 2 + 1, bending.segment<2>(k).norm(),
                                             subject_.robot.limits.max_bending_rad));
      }
    }
    stream_->Add(clock_.Now(), bending, c.valid_for_ns);
    ++samples_;
  }

  void CheckRunning() {
    client_.Handle(0);
    if (const std::string by = setup_.stopped_by(); !by.empty())
      throw std::runtime_error(fmt::format("stopped by {}: the robot holds the last target", by));
    if (!wrong_sample_.empty()) throw std::runtime_error(wrong_sample_ + "; the robot holds the last target");
    if (clock_.Now() - heard_ns_ > kSilence_ns) {
      throw std::runtime_error(
          "the daemon fell silent for a second: look at its log; the robot holds the last target");
    }
    if (state_.mode != tendril_lcm::state_t::MODE_RUNNING) {
      const Status reason = io::ReasonForMode(state_);
      const std::string why = reason == Status::kOk ? "" : fmt::format(" ({})", StatusText(reason));
      // Clearing alone does not bring back a robot whose tendons hang.
      const std::string_view remedy = state_.mode != tendril_lcm::state_t::MODE_FAULT
                                          ? "arm it first with `tendril send arm`"
                                      : reason == Status::kOk ? "clear it with `tendril send clear`, then arm"
                                                              : StatusRemedy(reason);
      throw std::runtime_error(fmt::format("the daemon is in mode {}{}: {}", state_.mode_text, why, remedy));
    }
    if (!another_leads_.empty()) {
      throw std::runtime_error(fmt::format("the daemon refuses these commands: {} ({})", another_leads_,
                                           static_cast<int>(Status::kAnotherSender)));
    }
    // A daemon that has a key answers nothing that is not signed with it.
    if (!answers_ && first_sequence_ && clock_.Now() - first_sent_ns_ > kSilence_ns) {
      throw std::runtime_error(
          "the daemon takes none of these commands" +
          (client_.ignored().empty() ? ": it does not receive them" : ": " + client_.ignored()) +
          "; the robot has not moved");
    }
    // Now and then one is overtaken by another or comes late; all of them do not.
    if (state_.commands_accepted == accepted_ && state_.commands_refused > refused_ + kMostRefused) {
      throw std::runtime_error(fmt::format("the daemon refuses these commands: {}; the robot has not moved",
                                           state_.command_status_text));
    }
    if (state_.target_distance_m > kOutOfReach_m) {
      throw std::runtime_error(fmt::format(
          "the daemon's robot cannot reach this motion by {:.1f} mm: is {} its robot file? The "
          "robot holds the last target",
          1e3 * state_.target_distance_m, setup_.robot_file.empty() ? "its own" : setup_.robot_file));
    }
  }

  void Send(Command command) {
    // As long again as the daemon extrapolates, or it would cut its own look ahead short.
    command.valid_for_ns = ToNs(kValidFor_s + extrapolates_s_);
    leads_until_ns_ = clock_.Now() + command.valid_for_ns + kLetGo_ns;
    const std::int64_t sequence = io::Publish(client_, command, setup_.lcm_url);
    if (first_sequence_) return;
    first_sequence_ = sequence;
    first_sent_ns_ = clock_.Now();
  }

  // Until then the daemon refuses targets of other senders, such as the next command of a script.
  void LetGo() const {
    std::this_thread::sleep_for(
        std::chrono::nanoseconds(std::max<TimeNs>(leads_until_ns_ - clock_.Now(), 0)));
  }

  // To the next point of the sending grid; points that a late scheduler passed over are left out, not made up
  // for.
  void SleepToNext(TimeNs& next_ns) const {
    const TimeNs now_ns = clock_.Now();
    while (next_ns <= now_ns) next_ns += kCommandPeriod_ns;
    std::this_thread::sleep_for(std::chrono::nanoseconds(next_ns - now_ns));
  }

  // The daemon's time: that of a simulated robot passes at a pace of its own, and falls behind on a busy
  // machine. By the state that was delayed least of the last ones, and never far beyond the next one, which
  // bounds the error where time passes more slowly than here.
  TimeNs DaemonNow() const {
    const auto known = std::min<std::size_t>(states_, daemon_ahead_ns_.size());
    const TimeNs ahead_ns = *std::max_element(daemon_ahead_ns_.begin(), daemon_ahead_ns_.begin() + known);
    const TimeNs every_ns = subject_.daemon.lcm.state_every_cycles * subject_.daemon.bus.cycle_ns;
    return std::min(clock_.Now() + ahead_ns, state_.utime * kNsPerUs + every_ns + kOverdueState_ns);
  }

  // To the first target, until the reference has rested there.
  void Approach(const Command& first) {
    const TimeNs start_ns = clock_.Now();
    TimeNs moving_ns = start_ns, next_ns = start_ns;
    while (clock_.Now() - moving_ns < kStillBefore_ns) {
      Send(first);
      SleepToNext(next_ns);
      CheckRunning();
      double gap = 0;
      for (std::size_t i = 0; i < state_.bending_target_rad.size(); ++i) {
        gap = std::max(gap, std::abs(state_.bending_target_rad[i] - state_.bending_desired_rad[i]));
      }
      if (gap > kArrivedBending_rad) moving_ns = clock_.Now();
      if (clock_.Now() - start_ns > kApproachAtMost_ns) {
        throw std::runtime_error("the motion's first target was not reached within 30 s");
      }
    }
  }

  void Stream(const Motion& motion) {
    const TimeNs start_ns = DaemonNow() + ToNs(lead_s_);
    TimeNs next_ns = clock_.Now();
    Errors of_reference, of_motion;
    int shown_s = -1;
    for (double t_s = -lead_s_; t_s < motion.duration_s(); t_s = ToSeconds(DaemonNow() - start_ns)) {
      Send(motion.SentAhead(t_s, lead_s_, extrapolates_s_));
      SleepToNext(next_ns);
      CheckRunning();
      const Eigen::Map<const Eigen::Vector3d> estimate(state_.tip_estimate_W_m),
          desired(state_.tip_desired_W_m);
      const double heard_s = ToSeconds(state_.utime * kNsPerUs - start_ns);
      if (heard_s >= motion.judged_from_s() && heard_s <= motion.judged_until_s() && estimate.allFinite()) {
        of_reference.Add((estimate - desired).norm());
        of_motion.Add((estimate - motion.TipAt(heard_s)).norm());
      }
      if (static_cast<int>(t_s) > shown_s) {
        shown_s = static_cast<int>(t_s);
        setup_.progress(fmt::format("{:3d} of {:.0f} s", shown_s, motion.duration_s()));
      }
    }
    if (of_motion.count == 0) {
      throw std::runtime_error(
          "the motion ended before the daemon published a state: see lcm.state_every_cycles in its file");
    }
    Tell("followed, sent {:.0f} ms ahead; over {} samples", 1e3 * lead_s_, of_motion.count);
    Tell("error of the estimated tip against the motion: {}", of_motion.Text());
    Tell("error of the estimated tip against the desired tip: {}", of_reference.Text());
  }

  const FollowSetup setup_;
  MonotonicClock clock_;
  std::unique_ptr<lcm::LCM> lcm_;
  io::Client client_;
  Subject subject_;
  double lead_s_ = 0, extrapolates_s_ = 0, delay_s_ = 0;
  tendril_lcm::run_t run_{};
  tendril_lcm::state_t state_{};
  TimeNs heard_ns_ = 0, leads_until_ns_ = 0, first_sent_ns_ = 0;
  std::optional<std::int64_t> first_sequence_;  // of the first target
  bool answers_ = false;                        // the daemon has seen it, or a later one
  std::array<TimeNs, 16> daemon_ahead_ns_{};    // the daemon's time less this clock's, by the last states
  std::uint64_t states_ = 0;
  TipSolver* solver_ = nullptr;
  std::optional<SampleStream> stream_;
  std::optional<std::uint32_t> last_sequence_;
  std::string wrong_sample_;
  std::string another_leads_;  // why our targets are refused; empty: they are not
  std::uint64_t samples_ = 0;
  std::int64_t accepted_ = 0, refused_ = 0;  // before the first command
};

Follower::Follower(const FollowSetup& setup) : impl_(std::make_unique<Impl>(setup)) {}
Follower::~Follower() = default;
const Subject& Follower::subject() const { return impl_->subject(); }
void Follower::Follow(const Motion& motion) { impl_->Follow(motion); }
void Follower::FollowSamples(const std::string& from, double delay_s, bool nearest) {
  impl_->FollowSamples(from, delay_s, nearest);
}

}  // namespace tendril::motion
