#include "tendril/commission/live_link.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>

#include "tendril/config/config.h"
#include "tendril/core/clock.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"

namespace tendril::commission {
namespace {

constexpr TimeNs kValidFor_ns = kNsPerS, kRepeat_ns = 50 * kNsPerMs, kSilence_ns = kNsPerS;
constexpr TimeNs kEnable_ns = 10 * kNsPerS;

}  // namespace

struct LiveLink::Impl {
 public:
  Impl(const std::string& url, const std::string& prefix, const std::atomic<bool>* stop)
      : stop_(stop),
        where_(url + " with prefix " + prefix),
        lcm_(io::OpenLcm(url)),
        client_(lcm_.get(), prefix) {
    lcm_->subscribe(io::ChannelName(prefix, "CYCLE"), &Impl::TakeCycle, this)->setQueueCapacity(2000);
    lcm_->subscribe(io::ChannelName(prefix, "RUN"), &Impl::TakeRun, this);
    client_.OnStatistics([this](const tendril_lcm::statistics_t& s) {
      for (std::size_t i = 0; i < s.drive_node_id.size(); ++i)
        serials_[s.drive_node_id[i]] = static_cast<std::uint32_t>(s.drive_serial[i]);
    });
    const TimeNs end_ns = clock_.Now() + 3 * kNsPerS;
    while (clock_.Now() < end_ns && (cycles_ < 2 || run_.robot_yaml.empty())) io::HandleWaiting(*lcm_, 20);
    if (run_.robot_yaml.empty()) {
      throw std::runtime_error(io::NobodyAnswers(url, prefix, 3, client_));
    }
    // The tracker's readings would fall between those that are published.
    if (const int every = Daemon().lcm.cycle_every_cycles; every != 1 || cycles_ < 2) {
      throw std::runtime_error(
          fmt::format("the daemon on {} publishes {}; commissioning reads every cycle: set "
                      "lcm.cycle_every_cycles to 1 in its file and start it again",
                      where_, every > 1 ? fmt::format("one of {} cycles", every) : std::string("no cycles")));
    }
  }
  ~Impl() { Disarm(); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  RobotParameters Robot() const { return config::ParseRobot(run_.robot_yaml, "the daemon's robot"); }
  DaemonParameters Daemon() const { return config::ParseDaemon(run_.daemon_yaml, "the daemon's file"); }
  Mode mode() const { return record_.output.mode; }
  const DriveSerials& serials() const { return serials_; }

  void Enter(int tendons) {
    if (mode() == Mode::kDisconnected) Await(Mode::kConfigured, 10);
    if (mode() != Mode::kConfigured) {
      throw std::runtime_error(
          fmt::format("the daemon is in mode {}{}; bring it to configured first ({})", ModeText(mode()),
                      StatusOf(), mode() == Mode::kFault ? "tendril send clear" : "tendril send disarm"));
    }
    Command command;
    command.kind = CommandKind::kMode;
    command.mode = ModeRequest::kCommission;
    // From here on it may pull, whether we hear of it or not.
    entered_ = true;
    Send(command);
    Await(Mode::kCommissioning, 2);
    Pull(TendonVector::Zero(tendons));
    const auto enabled = [this] {
      const CycleInput& in = record_.input;
      return std::all_of(in.drive.begin(), in.drive.begin() + in.drives,
                         [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
    };
    for (const TimeNs end_ns = clock_.Now() + kEnable_ns; !enabled();) {
      Next();
      if (clock_.Now() > end_ns)
        throw std::runtime_error("the drives are not enabled within 10 s: look at the daemon's log");
    }
    Pull(TendonVector::Zero(tendons));
  }

  void Pull(const TendonVector& pull_N) {
    pulls_ = true;
    pull_N_ = pull_N;
    Command command;
    command.kind = CommandKind::kTension;
    command.tension_N = pull_N_;
    Send(command);
    sent_ns_ = clock_.Now();
  }

  const CycleRecord& Next() {
    const std::uint64_t before = record_.input.cycle;
    while (record_.input.cycle == before) {
      if (stop_ && *stop_) {
        throw std::runtime_error(entered_ ? "stopped: the daemon was asked to disarm; nothing was written"
                                          : "stopped before any motor pulled");
      }
      if (clock_.Now() - heard_ns_ > kSilence_ns)
        throw std::runtime_error("the daemon stopped responding: see its log");
      if (pulls_ && clock_.Now() - sent_ns_ > kRepeat_ns) Pull(pull_N_);
      // One at a time: a cycle is not passed over.
      if (lcm_->handleTimeout(20) < 0 && errno != EINTR) throw std::runtime_error("LCM failed on " + where_);
    }
    if (pulls_ && mode() != Mode::kCommissioning) {
      throw std::runtime_error(
          fmt::format("the daemon left commissioning for {}{}", ModeText(mode()), StatusOf()));
    }
    return record_;
  }

 private:
  std::string StatusOf() const {
    const Status s = record_.output.status;
    if (s == Status::kOk) return {};
    return fmt::format(": {} {}; {}", static_cast<int>(s), StatusText(s), StatusRemedy(s));
  }
  void Await(Mode wanted, double timeout_s) {
    const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(timeout_s * 1e9);
    while (mode() != wanted) {
      Next();
      const Status refused = record_.output.command_status;
      if (clock_.Now() > end_ns) {
        throw std::runtime_error(
            fmt::format("the daemon does not change from {} to {}{}{}", ModeText(mode()), ModeText(wanted),
                        StatusOf(), refused == Status::kOk ? "" : fmt::format("; {}", StatusText(refused))));
      }
    }
  }
  void Send(Command command) {
    command.valid_for_ns = kValidFor_ns;
    io::Publish(client_, command, where_);
  }
  // However it ends: no motor is left under power.
  void Disarm() noexcept {
    if (!entered_) return;
    try {
      const TimeNs end_ns = clock_.Now() + 3 * kNsPerS;
      TimeNs again_ns = 0;
      do {
        if (clock_.Now() >= again_ns) {
          Command command;
          command.kind = CommandKind::kMode;
          command.mode = ModeRequest::kDisarm;
          Send(command);
          again_ns = clock_.Now() + 200 * kNsPerMs;
        }
        io::HandleWaiting(*lcm_, 20);
      } while (clock_.Now() < end_ns && mode() != Mode::kConfigured && mode() != Mode::kFault);
    } catch (const std::exception& e) {
      fmt::print(stderr, "disarm could not be sent, the daemon ends commissioning by itself: {}\n", e.what());
    }
  }

  void TakeCycle(const lcm::ReceiveBuffer* buffer, const std::string&) {
    if (!io::Decode(buffer->data, static_cast<int>(buffer->data_size), message_)) return;
    if (!io::FromMessage(message_, record_)) return;
    heard_ns_ = clock_.Now();
    ++cycles_;
  }
  void TakeRun(const lcm::ReceiveBuffer* buffer, const std::string&) {
    tendril_lcm::run_t run;
    if (io::Decode(buffer->data, static_cast<int>(buffer->data_size), run)) run_ = run;
  }

  const std::atomic<bool>* stop_;
  std::string where_;
  MonotonicClock clock_;
  std::unique_ptr<lcm::LCM> lcm_;
  io::Client client_;
  tendril_lcm::cycle_t message_{};
  tendril_lcm::run_t run_{};
  CycleRecord record_;
  DriveSerials serials_;
  TendonVector pull_N_;
  TimeNs heard_ns_ = 0, sent_ns_ = 0;
  std::uint64_t cycles_ = 0;
  bool entered_ = false, pulls_ = false;
};

LiveLink::LiveLink(const std::string& url, const std::string& channel_prefix, const std::atomic<bool>* stop)
    : impl_(std::make_unique<Impl>(url, channel_prefix, stop)) {}
LiveLink::~LiveLink() = default;
RobotParameters LiveLink::Robot() const { return impl_->Robot(); }
DaemonParameters LiveLink::Daemon() const { return impl_->Daemon(); }
const DriveSerials& LiveLink::serials() const { return impl_->serials(); }
void LiveLink::Enter(int tendons) { impl_->Enter(tendons); }
void LiveLink::Pull(const TendonVector& pull_N) { impl_->Pull(pull_N); }
const CycleRecord& LiveLink::Next() { return impl_->Next(); }

}  // namespace tendril::commission
