// Client side of the gateway; see the header.
#include "tendril/io/client.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "tendril/io/connection.h"
#include "tendril/io/epoch.h"
#include "tendril/io/signature.h"
#include "tendril/io/status_text.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

// Bits of a process id, which Linux keeps below 2^22; bits of the host's name above it distinguish computers.
// Without the top bit sequence numbers stay positive.
constexpr int kProcessBits = 22;
constexpr std::uint32_t kNotNegative = 0x7fff'ffff;

std::uint32_t ThisHost() {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '?';
  return (static_cast<std::uint32_t>(std::hash<std::string>{}(host.data())) << kProcessBits) & kNotNegative;
}

std::uint32_t TicksOfEpoch() {
  using Tick = std::chrono::duration<std::int64_t, std::ratio<1, 100'000>>;
  return static_cast<std::uint32_t>(
      std::chrono::duration_cast<Tick>(std::chrono::system_clock::now().time_since_epoch()).count());
}

}  // namespace

struct Client::State {
  State(std::unique_ptr<lcm::LCM> owned_lcm, lcm::LCM* shared, const std::string& channel_prefix,
        const std::string& key)
      : owned(std::move(owned_lcm)),
        lcm(owned ? owned.get() : shared),
        prefix(channel_prefix),
        tip_channel(ChannelName(prefix, "COMMAND_TIP")),
        bending_channel(ChannelName(prefix, "COMMAND_BENDING")),
        tension_channel(ChannelName(prefix, "COMMAND_TENSION")),
        mode_channel(ChannelName(prefix, "COMMAND_MODE")) {
    if (!key.empty()) signer.emplace(key);
    Subscribe<&State::event, &State::TakeEvent>("EVENT");
  }

  ~State() {
    for (lcm_subscription_t* s : subscriptions) lcm_unsubscribe(lcm->getUnderlyingLCM(), s);
  }

  template <auto Message, auto OnMessage>
  void Subscribe(const std::string& name) {
    subscriptions.push_back(lcm_subscribe(
        lcm->getUnderlyingLCM(), ChannelName(prefix, name).c_str(),
        [](const lcm_recv_buf_t* bytes, const char*, void* context) {
          auto* self = static_cast<State*>(context);
          // LCM leaves an array unchanged when the next message has none.
          self->*Message = {};
          // Messages of another version are ignored.
          if (!Decode(bytes->data, static_cast<int>(bytes->data_size), self->*Message)) return;
          (self->*OnMessage)();
        },
        this));
  }

  template <class Message>
  bool Publish(const std::string& channel, const Message& message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    if (message.encode(bytes.data(), 0, static_cast<int>(bytes.size())) < 0) return false;
    if (signer) signer->Sign(channel, EpochUs(), bytes);
    return lcm->publish(channel, bytes.data(), static_cast<unsigned>(bytes.size())) == 0;
  }

  void TakeState() { state_sink(state); }
  void TakeStatistics() { statistics_sink(statistics); }
  void TakeRun() { run_sink(run); }
  void TakeEvent() {
    if (event.source == "daemon" && event.text.starts_with("waiting: ")) waits = event.text;
    if (event.source == "gateway" && event.text.starts_with(prefix + "_COMMAND_")) ignored = event.text;
    if (event_sink) event_sink(event);
  }

  std::unique_ptr<lcm::LCM> owned;
  lcm::LCM* lcm;
  std::optional<Signer> signer;
  std::string prefix, tip_channel, bending_channel, tension_channel, mode_channel;
  std::vector<lcm_subscription_t*> subscriptions;
  StateSink state_sink;
  EventSink event_sink;
  StatisticsSink statistics_sink;
  RunSink run_sink;
  tendril_lcm::state_t state{};
  tendril_lcm::event_t event{};
  tendril_lcm::statistics_t statistics{};
  tendril_lcm::run_t run{};
  std::string waits, ignored;
};

Client::Client(const std::string& url, const std::string& channel_prefix, const std::string& key)
    : state_(std::make_unique<State>(OpenLcm(url), nullptr, channel_prefix, key)) {}

Client::Client(lcm::LCM* lcm, const std::string& channel_prefix, const std::string& key)
    : state_(std::make_unique<State>(nullptr, lcm, channel_prefix, key)) {}

Client::~Client() = default;

void Client::OnState(StateSink sink) {
  const bool first = !state_->state_sink;
  state_->state_sink = std::move(sink);
  if (first) state_->Subscribe<&State::state, &State::TakeState>("STATE");
}

void Client::OnEvent(EventSink sink) { state_->event_sink = std::move(sink); }

const std::string& Client::waits() const noexcept { return state_->waits; }
const std::string& Client::ignored() const noexcept { return state_->ignored; }

void Client::OnStatistics(StatisticsSink sink) {
  const bool first = !state_->statistics_sink;
  state_->statistics_sink = std::move(sink);
  if (first) state_->Subscribe<&State::statistics, &State::TakeStatistics>("STATISTICS");
}

void Client::OnRun(RunSink sink) {
  const bool first = !state_->run_sink;
  state_->run_sink = std::move(sink);
  if (first) state_->Subscribe<&State::run, &State::TakeRun>("RUN");
}

namespace {

template <class Message>
Message WithHeader(const Command& command, std::int64_t utime) {
  Message m{};
  m.utime = utime;
  m.sequence = SequenceOf(command);
  m.valid_for_s = ToSeconds(command.valid_for_ns);
  return m;
}

}  // namespace

bool Client::Send(const Command& c, std::int64_t utime) {
  State& s = *state_;
  switch (c.kind) {
    case CommandKind::kNone:
      return false;
    case CommandKind::kTip: {
      auto m = WithHeader<tendril_lcm::command_tip_t>(c, utime);
      m.speed_radps = c.speed_radps;
      for (int i = 0; i < 3; ++i) {
        m.tip_W_m[i] = c.tip_W_m[i];
        m.tip_velocity_W_mps[i] = c.tip_velocity_W_mps[i];
      }
      return s.Publish(s.tip_channel, m);
    }
    case CommandKind::kBending: {
      auto m = WithHeader<tendril_lcm::command_bending_t>(c, utime);
      m.speed_radps = c.speed_radps;
      m.num_bending = static_cast<int>(c.bending_rad.size());
      m.num_rate = static_cast<int>(c.bending_rate_radps.size());
      m.bending_rad.assign(c.bending_rad.begin(), c.bending_rad.end());
      m.bending_rate_radps.assign(c.bending_rate_radps.begin(), c.bending_rate_radps.end());
      return s.Publish(s.bending_channel, m);
    }
    case CommandKind::kTension: {
      auto m = WithHeader<tendril_lcm::command_tension_t>(c, utime);
      m.speed_radps = c.speed_radps;
      m.num_tendons = static_cast<int>(c.tension_N.size());
      m.tension_base_N.assign(c.tension_N.begin(), c.tension_N.end());
      return s.Publish(s.tension_channel, m);
    }
    case CommandKind::kMode: {
      auto m = WithHeader<tendril_lcm::command_mode_t>(c, utime);
      m.request = static_cast<std::int8_t>(c.mode);
      return s.Publish(s.mode_channel, m);
    }
  }
  return false;
}

int Client::Handle(int timeout_ms) { return HandleWaiting(*state_->lcm, timeout_ms); }

std::string NobodyAnswers(const std::string& url, const std::string& channel_prefix, double within_s,
                          const Client& client) {
  return NobodyAnswersText(url, channel_prefix, within_s, client.waits());
}

bool SendTracker(lcm::LCM& lcm, const std::string& channel, const TrackerSample& sample, std::int64_t utime) {
  tendril_lcm::tracker_t message{};
  message.utime = utime;
  message.valid = sample.valid;
  for (int i = 0; i < 3; ++i) message.tip_W_m[i] = sample.tip_W_m[i];
  message.orientation_WT[0] = sample.orientation_WT.w();
  message.orientation_WT[1] = sample.orientation_WT.x();
  message.orientation_WT[2] = sample.orientation_WT.y();
  message.orientation_WT[3] = sample.orientation_WT.z();
  return lcm.publish(channel, &message) == 0;
}

std::int64_t Publish(Client& client, Command& command, const std::string& url) {
  static std::mutex sending;  // a number is not overtaken by the next one's message
  const std::lock_guard lock(sending);
  command.sequence = NextSequence();
  command.sender = SenderOfProcess();
  if (!client.Send(command, EpochUs())) {
    throw std::runtime_error("LCM could not send the command on " + url +
                             ": check the address and the route");
  }
  return SequenceOf(command);
}

std::uint32_t NextSequence() {
  static std::atomic<std::uint32_t> latest = TicksOfEpoch() - 1;
  std::uint32_t before = latest, next = 0;
  do {
    const std::uint32_t now = TicksOfEpoch();
    // Two in one tick, or a clock that was set back: the number increases all the same. It may wrap.
    next = static_cast<std::int32_t>(now - before) > 0 ? now : before + 1;
  } while (!latest.compare_exchange_weak(before, next));
  return next;
}

std::uint32_t SenderOfProcess() { return ThisHost() | static_cast<std::uint32_t>(getpid()); }

std::int64_t SequenceOf(const Command& c) {
  return static_cast<std::int64_t>((std::uint64_t{c.sender} << 32) | c.sequence);
}

std::uint32_t SenderOf(std::int64_t sequence) {
  return static_cast<std::uint32_t>(static_cast<std::uint64_t>(sequence) >> 32);
}

std::string SenderText(std::uint32_t sender) {
  if (sender == 0) return "an unnamed program";
  const std::uint32_t process = sender % (1U << kProcessBits);
  if (process != 0 && sender - process == ThisHost()) return "process " + std::to_string(process);
  return "sender " + std::to_string(sender);
}

Status ReasonForMode(const tendril_lcm::state_t& state) {
  for (const std::int16_t number : state.reported) {
    if (ExplainsMode(static_cast<Status>(number))) return static_cast<Status>(number);
  }
  return Status::kOk;
}

}  // namespace tendril::io
