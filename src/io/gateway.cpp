// LCM in and out; see the header.
#include "tendril/io/gateway.h"

#include <algorithm>
#include <lcm/lcm-cpp.hpp>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "tendril/io/connection.h"
#include "tendril/io/epoch.h"
#include "tendril/io/signature.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

// Longer than any wait in our own queue. An apparent wait beyond this, or below zero, spans a step of the
// wall clock.
constexpr std::int64_t kLongestWait_us = 5'000'000;

// Undecodable messages give one event per second; the counter has the total.
constexpr TimeNs kComplaintEvery_ns = kNsPerS;

template <class Message>
constexpr bool kCommands =
    !std::is_same_v<Message, tendril_lcm::tracker_t> && !std::is_same_v<Message, tendril_lcm::run_t>;

}  // namespace

struct Gateway::State {
  State(const LcmParameters& lcm_parameters, const RobotShape& robot_shape, const Clock& gateway_clock)
      : parameters(lcm_parameters),
        shape(robot_shape),
        clock(gateway_clock),
        real(dynamic_cast<const MonotonicClock*>(&gateway_clock) != nullptr),
        epoch_offset_us(EpochOffsetUs(gateway_clock)),
        state_channel(ChannelName(parameters.channel_prefix, "STATE")),
        cycle_channel(ChannelName(parameters.channel_prefix, "CYCLE")),
        run_channel(ChannelName(parameters.channel_prefix, "RUN")),
        event_channel(ChannelName(parameters.channel_prefix, "EVENT")),
        statistics_channel(ChannelName(parameters.channel_prefix, "STATISTICS")),
        lcm(OpenLcm(parameters.url)) {
    if (!parameters.key_file.empty()) verifier.emplace(LoadKey(parameters.key_file), EpochUs());
  }

  std::int64_t UtimeOf(TimeNs t_ns) const { return t_ns / kNsPerUs + epoch_offset_us; }

  // Arrival of a message on the monotonic clock: now, less its wait in this process. The sender's time stamp
  // is not used, because either wall clock may be wrong or stepped.
  TimeNs Arrival(const lcm_recv_buf_t& bytes) const {
    const TimeNs now_ns = clock.Now();
    if (!real) return now_ns;
    const std::int64_t waited_us = EpochUs() - bytes.recv_utime;
    return waited_us > 0 && waited_us < kLongestWait_us ? now_ns - waited_us * kNsPerUs : now_ns;
  }

  // The time of a measurement, from the present wall clock. A time stamp in the future counts as now.
  TimeNs OnOurClock(std::int64_t utime) const {
    const TimeNs now_ns = clock.Now();
    if (utime <= 0) return now_ns;
    const std::int64_t now_us = real ? EpochUs() : UtimeOf(now_ns);
    return now_ns - std::max<std::int64_t>(now_us - utime, 0) * kNsPerUs;
  }

  template <class Message>
  void Publish(const std::string& channel, const Message& message) {
    const int size = message.getEncodedSize();
    if (buffer.size() < static_cast<std::size_t>(size)) buffer.resize(static_cast<std::size_t>(size));
    if (message.encode(buffer.data(), 0, size) != size ||
        lcm->publish(channel, buffer.data(), static_cast<unsigned>(size)) != 0) {
      ++counters.publish_failed;
    } else {
      ++counters.published;
    }
    if (tap) tap(channel, buffer.data(), size);
  }

  void PublishEvent(TimeNs time_ns, Status status, const std::string& source, const std::string& text) {
    event.utime = UtimeOf(time_ns);
    event.status = static_cast<std::int16_t>(status);
    event.status_text = StatusText(status);
    event.source = source;
    event.text = text;
    Publish(event_channel, event);
  }

  void Complain(const std::string& channel, const std::string& why) {
    ++counters.undecodable;
    complaint = channel + ": message ignored: " + why;
    TellComplaint();
  }

  /// The last one, a while after the one before: whoever sent it waits for its reason.
  void TellComplaint() {
    if (complaint.empty()) return;
    const TimeNs now_ns = clock.Now();
    if (complained && now_ns - complained_ns < kComplaintEvery_ns) return;
    complained = true;
    complained_ns = now_ns;
    const std::string text =
        std::exchange(complaint, {}) + "; " + std::to_string(counters.undecodable) + " ignored since start";
    PublishEvent(now_ns, Status::kMessageIgnored, "gateway", text);
    if (complaint_sink) complaint_sink(Status::kMessageIgnored, text);
  }

  template <class Message>
  void Received(const lcm_recv_buf_t* bytes, const char* channel, Message& message) {
    ++counters.received;
    if (verifier && kCommands<Message>) {
      const std::string why = verifier->Refusal(channel, bytes->data, bytes->data_size, EpochUs());
      if (!why.empty()) {
        Complain(channel, why);
        return;
      }
    }
    if (!Decode(bytes->data, static_cast<int>(bytes->data_size), message)) {
      Complain(channel, "these bytes are not the message of this channel (compare the sender's lcm_types)");
      return;
    }
    Process(channel, message, Arrival(*bytes));
  }

  template <class Message>
  void Process(const char* channel, const Message& message, TimeNs arrival_ns) {
    Command command;
    if (const std::string why = FromMessage(message, command); !why.empty()) {
      Complain(channel, why);
      return;
    }
    command.received_ns = arrival_ns;
    if (command_sink) command_sink(command);
  }

  void Process(const char* /*channel*/, const tendril_lcm::tracker_t& message, TimeNs /*arrival_ns*/) {
    TrackerSample sample;
    sample.valid = message.valid != 0;
    sample.time_ns = OnOurClock(message.utime);
    sample.tip_W_m = {message.tip_W_m[0], message.tip_W_m[1], message.tip_W_m[2]};
    sample.orientation_WT = {message.orientation_WT[0], message.orientation_WT[1], message.orientation_WT[2],
                             message.orientation_WT[3]};
    if (tracker_sink) tracker_sink(sample);
  }

  void Process(const char* /*channel*/, const tendril_lcm::run_t& message, TimeNs /*arrival_ns*/) {
    RunInfo info;
    FromMessage(message, info);
    if (run_sink) run_sink(info);
  }

  template <auto Message>
  static void Handler(const lcm_recv_buf_t* bytes, const char* channel, void* state) {
    auto* self = static_cast<State*>(state);
    self->Received(bytes, channel, self->*Message);
  }

  template <auto Message>
  void Subscribe(const std::string& name) {
    lcm_subscribe(lcm->getUnderlyingLCM(), ChannelName(parameters.channel_prefix, name).c_str(),
                  &Handler<Message>, this);
  }

  LcmParameters parameters;
  RobotShape shape;
  const Clock& clock;
  bool real;  // this machine's time, not a simulated one
  std::int64_t epoch_offset_us;
  std::string state_channel, cycle_channel, run_channel, event_channel, statistics_channel;
  std::unique_ptr<lcm::LCM> lcm;
  std::optional<Verifier> verifier;  // none: any command is accepted
  CommandSink command_sink;
  TrackerSink tracker_sink;
  RunSink run_sink;
  ComplaintSink complaint_sink;
  Tap tap;
  Counters counters;
  std::string complaint;  // not told yet
  bool complained = false;
  TimeNs complained_ns = 0;
  bool any_state = false;
  Mode last_mode = Mode::kDisconnected;
  Status last_status = Status::kOk;
  std::string why_refused;  // the last command

  // Reused, so that a cycle is published without allocating.
  std::vector<std::uint8_t> buffer;
  tendril_lcm::state_t state{};
  tendril_lcm::cycle_t cycle{};
  tendril_lcm::event_t event{};
  tendril_lcm::statistics_t statistics{};
  tendril_lcm::command_tip_t tip{};
  tendril_lcm::command_bending_t bending{};
  tendril_lcm::command_tension_t tension{};
  tendril_lcm::command_mode_t mode{};
  tendril_lcm::tracker_t tracker{};
  tendril_lcm::run_t run{};
};

Gateway::Gateway(const LcmParameters& lcm, const RobotShape& shape, const Clock& clock)
    : state_(std::make_unique<State>(lcm, shape, clock)) {
  state_->Subscribe<&State::tip>("COMMAND_TIP");
  state_->Subscribe<&State::bending>("COMMAND_BENDING");
  state_->Subscribe<&State::tension>("COMMAND_TENSION");
  state_->Subscribe<&State::mode>("COMMAND_MODE");
  state_->Subscribe<&State::tracker>("TRACKER");
}

Gateway::~Gateway() = default;

void Gateway::OnCommand(CommandSink sink) { state_->command_sink = std::move(sink); }
void Gateway::OnTracker(TrackerSink sink) { state_->tracker_sink = std::move(sink); }
void Gateway::OnRun(RunSink sink) {
  if (!state_->run_sink) state_->Subscribe<&State::run>("RUN");
  state_->run_sink = std::move(sink);
}
void Gateway::OnComplaint(ComplaintSink sink) { state_->complaint_sink = std::move(sink); }
void Gateway::SetTap(Tap tap) { state_->tap = std::move(tap); }

int Gateway::Handle(int timeout_ms) {
  const int handled = HandleWaiting(*state_->lcm, timeout_ms);
  state_->TellComplaint();
  return handled;
}

void Gateway::PublishRun(const RunInfo& run) {
  State& s = *state_;
  tendril_lcm::run_t message{};
  ToMessage(run, s.shape, s.UtimeOf(s.clock.Now()), message);
  s.Publish(s.run_channel, message);
}

void Gateway::PublishState(const CycleRecord& record, const std::string& why, const std::string& detail) {
  State& s = *state_;
  if (record.input.command.kind != CommandKind::kNone) s.why_refused = why;
  const CycleOutput& out = record.output;
  const bool news = !s.any_state || record.input.command.kind != CommandKind::kNone ||
                    out.mode != s.last_mode || out.status != s.last_status;
  s.any_state = true;
  s.last_mode = out.mode;
  s.last_status = out.status;
  const auto every = static_cast<std::uint64_t>(std::max(s.parameters.state_every_cycles, 1));
  if (!news && record.input.cycle % every != 0) return;
  ToMessage(record, s.shape, s.UtimeOf(record.input.time_ns), s.state);
  if (!s.why_refused.empty()) s.state.command_status_text = s.why_refused;
  if (!detail.empty()) s.state.status_text += " (" + detail + ")";
  s.Publish(s.state_channel, s.state);
}

void Gateway::PublishCycle(const CycleRecord& record) {
  State& s = *state_;
  if (s.parameters.cycle_every_cycles <= 0) return;
  if (record.input.cycle % static_cast<std::uint64_t>(s.parameters.cycle_every_cycles) != 0) return;
  ToMessage(record, s.shape, s.UtimeOf(record.input.time_ns), s.cycle);
  s.Publish(s.cycle_channel, s.cycle);
}

void Gateway::PublishStatistics(const LoopStatistics& statistics) {
  State& s = *state_;
  ToMessage(statistics, s.UtimeOf(statistics.time_ns), s.statistics);
  s.Publish(s.statistics_channel, s.statistics);
}

void Gateway::PublishEvent(TimeNs time_ns, Status status, const std::string& source,
                           const std::string& text) {
  state_->PublishEvent(time_ns, status, source, text);
}

Gateway::Counters Gateway::counters() const { return state_->counters; }
const std::string& Gateway::channel_prefix() const { return state_->parameters.channel_prefix; }
lcm::LCM* Gateway::lcm() const { return state_->lcm.get(); }

}  // namespace tendril::io
