// A client of a daemon on LCM. Messages are handed over as their bytes, which the package decodes; commands
// go through the io room, with its sender number and its wait for the daemon's answer.
#include "tendril/io/client.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "interruptible.h"
#include "mode_request.h"
#include "module.h"
#include "tendril/core/tip_unit.h"
#include "tendril/core/usage_error.h"
#include "tendril/io/send_command.h"
#include "tendril/io/status_text.h"
#include "tendril/motion/follower.h"
#include "tendril/motion/requested_motion.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"
#include "tendril_lcm/state_t.hpp"
#include "tendril_lcm/statistics_t.hpp"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using Bytes = std::string;

constexpr std::size_t kMostKept = 1000;  // states and events that nobody fetched; the oldest go

template <class Message>
Bytes Encoded(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()), '\0');
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

nb::object ToPython(const std::optional<Bytes>& bytes) {
  return bytes ? nb::object(nb::bytes(bytes->data(), bytes->size())) : nb::none();
}

/// What has been received so far; filled by a thread of its own.
class Listener {
 public:
  Listener(const std::string& url, const std::string& prefix, const std::string& key)
      : client_(url, prefix, key) {
    client_.OnState([this](const tendril_lcm::state_t& m) {
      Put([&] { states_.push_back(Encoded(m)), ++count_, received_ = Clock::now(); });
    });
    client_.OnEvent([this](const tendril_lcm::event_t& m) { Put([&] { events_.push_back(Encoded(m)); }); });
    client_.OnStatistics(
        [this](const tendril_lcm::statistics_t& m) { Put([&] { statistics_ = Encoded(m); }); });
    client_.OnRun([this](const tendril_lcm::run_t& m) { Put([&] { run_ = Encoded(m); }); });
    thread_ = std::thread([this] {
      while (!over_) client_.Handle(kHandle_ms), Put([&] { waits_ = client_.waits(); });
    });
  }
  ~Listener() {
    over_ = true;
    thread_.join();
  }

  /// The newest state with its number if it came within the last `max_age_s`, else the next one, waited for.
  /// None within the time: empty.
  std::optional<std::pair<std::int64_t, Bytes>> State(double max_age_s, double timeout_s) {
    std::unique_lock lock(mutex_);
    const auto oldest = Clock::now() - std::chrono::duration<double>(max_age_s);
    const auto fresh = [&] { return count_ > 0 && received_ >= oldest; };
    if (!changed_.wait_for(lock, std::chrono::duration<double>(timeout_s), fresh)) return std::nullopt;
    return std::pair(count_, states_.back());
  }
  /// The state that follows the `after`-th, or the oldest kept.
  std::optional<std::pair<std::int64_t, Bytes>> Next(std::int64_t after, double timeout_s) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::duration<double>(timeout_s), [&] { return count_ > after; });
    if (count_ <= after) return std::nullopt;
    const auto kept = static_cast<std::int64_t>(states_.size());
    const std::int64_t behind = std::min(count_ - after, kept);
    return std::pair(count_ - behind + 1, states_[static_cast<std::size_t>(kept - behind)]);
  }
  std::deque<Bytes> TakeEvents() {
    const std::lock_guard lock(mutex_);
    return std::exchange(events_, {});
  }
  std::optional<Bytes> Statistics() const { return Get(statistics_); }
  std::optional<Bytes> Run(double timeout_s) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::duration<double>(timeout_s), [&] { return run_.has_value(); });
    return run_;
  }
  std::string waits() const { return Get(waits_); }
  /// To send: what it received belongs to the thread.
  io::Client& client() { return client_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr int kHandle_ms = 20;

  template <class Change>
  void Put(const Change& change) {
    const std::lock_guard lock(mutex_);
    change();
    if (states_.size() > kMostKept) states_.pop_front();
    if (events_.size() > kMostKept) events_.pop_front();
    changed_.notify_all();
  }
  template <class T>
  T Get(const T& value) const {
    const std::lock_guard lock(mutex_);
    return value;
  }

  io::Client client_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Bytes> states_, events_;
  std::int64_t count_ = 0;
  Clock::time_point received_;
  std::optional<Bytes> statistics_, run_;
  std::string waits_;
  std::atomic<bool> over_{false};
  std::thread thread_;
};

ModeRequest ModeNamed(const std::string& name) {
  if (const auto request = FindModeRequest(name)) return *request;
  throw UsageError("'" + name + "' is no request; accepted: arm, disarm, hold, clear");
}

template <class Vector>
Vector ToVector(const std::vector<double>& values, int most, const char* what) {
  if (values.size() > static_cast<std::size_t>(most))
    throw UsageError(std::string(what) + ": " + std::to_string(values.size()) +
                     " values; accepted: at most " + std::to_string(most));
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

class Client {
 public:
  Client(std::string url, std::string prefix) : url_(std::move(url)), prefix_(std::move(prefix)) {
    listener_ = std::make_shared<Listener>(url_, prefix_, key_);
  }

  nb::object State(double max_age_s, double timeout_s) {
    return Numbered([&, heard = listener()] { return heard->State(max_age_s, timeout_s); });
  }
  nb::object Next(std::int64_t after, double timeout_s) {
    return Numbered([&, heard = listener()] { return heard->Next(after, timeout_s); });
  }
  nb::list Events() {
    nb::list list;
    for (const Bytes& event : listener()->TakeEvents()) list.append(nb::bytes(event.data(), event.size()));
    return list;
  }
  nb::object Statistics() { return ToPython(listener()->Statistics()); }
  nb::object RunRecord(double timeout_s) {
    const auto heard = listener();
    std::optional<Bytes> found;
    {
      const nb::gil_scoped_release released;
      found = heard->Run(timeout_s);
    }
    return ToPython(found);
  }
  std::string NobodyAnswers(double within_s) {
    return io::NobodyAnswersText(url_, prefix_, within_s, listener()->waits());
  }

  std::string Mode(const std::string& request, double timeout_s, const nb::object& waiting) {
    Command command;
    command.kind = CommandKind::kMode;
    command.mode = ModeNamed(request);
    command.valid_for_ns = kNsPerS;
    return Send(command, timeout_s, waiting);
  }
  std::string Tip(const std::vector<double>& tip_m, const std::vector<double>& velocity_mps,
                  double speed_radps, double valid_for_s, double timeout_s) {
    Command command;
    command.kind = CommandKind::kTip;
    command.tip_W_m = {tip_m.at(0), tip_m.at(1), tip_m.at(2)};
    command.tip_velocity_W_mps = {velocity_mps.at(0), velocity_mps.at(1), velocity_mps.at(2)};
    if (const std::string asked = AskMillimetres(command.tip_W_m); !asked.empty())
      throw UsageError("tip is out of any robot's reach" + asked + "; give metres");
    return Target(command, speed_radps, valid_for_s, timeout_s);
  }
  std::string Bending(const std::vector<double>& bending_rad, const std::vector<double>& rate_radps,
                      double speed_radps, double valid_for_s, double timeout_s) {
    Command command;
    command.kind = CommandKind::kBending;
    command.bending_rad = ToVector<BendingVector>(bending_rad, 2 * kMaxSections, "bending");
    command.bending_rate_radps = ToVector<BendingVector>(rate_radps, 2 * kMaxSections, "rate");
    return Target(command, speed_radps, valid_for_s, timeout_s);
  }
  std::string Tension(const std::vector<double>& tension_N, double valid_for_s, double timeout_s) {
    Command command;
    command.kind = CommandKind::kTension;
    command.tension_N = ToVector<TendonVector>(tension_N, kMaxTendons, "tension");
    return Target(command, 0, valid_for_s, timeout_s);
  }
  /// A motion as `tendril follow` words it, at its end with what it said of how well it went.
  std::string Follow(const motion::MotionRequest& request, const std::string& robot_file,
                     const nb::object& progress) {
    listener();
    const auto said = std::make_shared<std::string>();
    const auto work = std::make_shared<Work>();
    const auto say = [said](const std::string& line) { *said += line + "\n"; };
    const motion::FollowSetup setup{
        .lcm_url = url_,
        .channel_prefix = prefix_,
        .robot_file = robot_file,
        .stopped_by = [work] { return std::string(work->stopped() ? "Ctrl-C" : ""); },
        .tell = say,
        .progress = [work = work.get()](const std::string& line) { work->Tell(line, 0); },
        .key = key_};
    Run(
        work,
        [=] {
          motion::Follower follower(setup);
          const auto& subject = follower.subject();
          follower.Follow(*motion::MakeRequestedMotion(request, subject.robot,
                                                       subject.daemon.controller.trajectory, say));
        },
        progress);
    return *said;
  }
  void Close() {
    auto last = std::exchange(listener_, nullptr);
    const nb::gil_scoped_release released;
    last.reset();
  }
  /// After a fork, in the child: connection and thread are the parent's, and nothing here can end them.
  void LeaveToParent() { (void)new std::shared_ptr<Listener>(std::exchange(listener_, nullptr)); }
  bool closed() const { return !listener_; }
  const std::string& url() const { return url_; }
  const std::string& prefix() const { return prefix_; }

 private:
  /// Kept by every call, because another thread may close the client meanwhile.
  std::shared_ptr<Listener> listener() const {
    if (!listener_) throw UsageError("this client is closed; open another one: tendril.Client()");
    return listener_;
  }

  template <class Find>
  static nb::object Numbered(const Find& find) {
    std::optional<std::pair<std::int64_t, Bytes>> found;
    {
      const nb::gil_scoped_release released;
      found = find();
    }
    if (!found) return nb::none();
    return nb::make_tuple(found->first, nb::bytes(found->second.data(), found->second.size()));
  }

  std::string Target(Command& command, double speed_radps, double valid_for_s, double timeout_s) {
    command.speed_radps = speed_radps;
    command.valid_for_ns = static_cast<TimeNs>(valid_for_s * static_cast<double>(kNsPerS));
    return Send(command, timeout_s, nb::none());
  }

  /// With a time: on a connection of its own, until the daemon has answered; else at once on this one.
  std::string Send(Command command, double timeout_s, const nb::object& waiting) {
    if (timeout_s <= 0) {
      const auto heard = listener();
      const nb::gil_scoped_release released;
      io::Publish(heard->client(), command, url_);
      return {};
    }
    listener();
    const auto answer = std::make_shared<std::string>();
    const auto work = std::make_shared<Work>();
    Run(
        work,
        [=, call = io::CommandCall{url_, prefix_, command, timeout_s, work->stop(), key_}] {
          *answer = io::SendCommand(call, [&](const std::string& what) { work->Report(what, 0); });
        },
        waiting);
    return *answer;
  }

  std::string url_, prefix_;
  std::string key_ = io::KeyOfEnvironment();  // as long as it is open: it can always disarm what it armed
  std::shared_ptr<Listener> listener_;
};

void AddMotionRequest(nb::module_& m) {
  using motion::MotionRequest;
  nb::class_<MotionRequest>(m, "MotionRequest")
      .def(nb::init<>())
      .def_rw("kind", &MotionRequest::kind)
      .def_rw("tips", &MotionRequest::tips)
      .def_rw("bends", &MotionRequest::bends)
      .def_rw("points", &MotionRequest::points)
      .def_rw("nearest", &MotionRequest::nearest)
      .def_rw("stretch", &MotionRequest::stretch)
      .def_rw("speed", &MotionRequest::speed_radps)
      .def_rw("acceleration", &MotionRequest::acceleration_radps2)
      .def_rw("jerk", &MotionRequest::jerk_radps3);
}

}  // namespace

void AddClient(nb::module_& m) {
  m.def("sender", &io::SenderOfProcess, "Sender number of this process's commands.");
  AddMotionRequest(m);
  nb::class_<Client>(m, "Client")
      .def(nb::init<std::string, std::string>(), nb::arg("url"), nb::arg("prefix"))
      .def("state", &Client::State, nb::arg("max_age"), nb::arg("timeout"),
           nb::sig("def state(self, max_age: float, timeout: float) -> tuple[int, bytes] | None"))
      .def("next", &Client::Next, nb::arg("after"), nb::arg("timeout"),
           nb::sig("def next(self, after: int, timeout: float) -> tuple[int, bytes] | None"))
      .def("events", &Client::Events, nb::sig("def events(self) -> list[bytes]"))
      .def("statistics", &Client::Statistics, nb::sig("def statistics(self) -> bytes | None"))
      .def("run", &Client::RunRecord, nb::arg("timeout"),
           nb::sig("def run(self, timeout: float) -> bytes | None"))
      .def("nobody_answers", &Client::NobodyAnswers, nb::arg("within"))
      .def("mode", &Client::Mode, nb::arg("request"), nb::arg("timeout"), nb::arg("waiting").none())
      .def("tip", &Client::Tip, nb::arg("tip"), nb::arg("velocity"), nb::arg("speed"), nb::arg("valid_for"),
           nb::arg("timeout"))
      .def("bending", &Client::Bending, nb::arg("bending"), nb::arg("rate"), nb::arg("speed"),
           nb::arg("valid_for"), nb::arg("timeout"))
      .def("tension", &Client::Tension, nb::arg("tension"), nb::arg("valid_for"), nb::arg("timeout"))
      .def("follow", &Client::Follow, nb::arg("request"), nb::arg("robot_file"), nb::arg("progress").none())
      .def("close", &Client::Close)
      .def("leave_to_parent", &Client::LeaveToParent)
      .def_prop_ro("closed", &Client::closed)
      .def_prop_ro("url", &Client::url)
      .def_prop_ro("prefix", &Client::prefix);
}

}  // namespace tendril::python
