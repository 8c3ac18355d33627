// Conversions between structs and messages: nothing is lost, and no bytes can do harm.
#include "tendril/io/wire.h"

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "random_record.h"

namespace tendril::io {
namespace {

constexpr RobotShape kShape{2, 8, 6};

template <class T>
void ExpectBits(const T& a, const T& b, const char* what) {
  EXPECT_EQ(std::memcmp(&a, &b, sizeof(T)), 0) << what;
}

template <class V>
void ExpectVector(const V& a, const V& b, const char* what) {
  ASSERT_EQ(a.size(), b.size()) << what;
  EXPECT_EQ(std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())), 0) << what;
}

template <class Message>
std::vector<std::uint8_t> Encode(const Message& m) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(m.getEncodedSize()));
  m.encode(bytes.data(), 0, m.getEncodedSize());
  return bytes;
}

template <class Message>
bool DecodeBytes(const std::vector<std::uint8_t>& bytes, Message& m) {
  return Decode(bytes.data(), static_cast<int>(bytes.size()), m);
}

}  // namespace

// Field by field: written against core/cycle.h, not against the conversion.
void ExpectSameBits(const CycleRecord& a, const CycleRecord& b) {
#define SAME(field) ExpectBits(a.field, b.field, #field)
#define SAME_VECTOR(field) ExpectVector(a.field, b.field, #field)
  SAME(input.cycle);
  SAME(input.time_ns);
  SAME(input.bus_ok);
  SAME(input.late);
  SAME(input.drives);
  for (std::size_t i = 0; i < kMaxTendons; ++i) {
    SAME(input.drive[i].state);
    SAME(input.drive[i].statusword);
    SAME(input.drive[i].error_code);
    SAME(input.drive[i].position_counts);
    SAME(input.drive[i].torque_permille);
    SAME(input.drive[i].analog_mV);
    SAME(input.drive[i].age_cycles);
  }
  SAME(input.command.kind);
  SAME(input.command.sequence);
  SAME(input.command.sender);
  SAME(input.command.received_ns);
  SAME(input.command.valid_for_ns);
  SAME(input.command.mode);
  SAME_VECTOR(input.command.tip_W_m);
  SAME_VECTOR(input.command.tip_velocity_W_mps);
  SAME_VECTOR(input.command.bending_rad);
  SAME_VECTOR(input.command.bending_rate_radps);
  SAME_VECTOR(input.command.tension_N);
  SAME(input.command.speed_radps);
  SAME(input.tracker.valid);
  SAME(input.tracker.time_ns);
  SAME_VECTOR(input.tracker.tip_W_m);
  SAME_VECTOR(input.tracker.orientation_WT.coeffs());
  SAME(output.cycle);
  SAME(output.time_ns);
  SAME(output.mode);
  SAME(output.status);
  SAME(output.drive_request);
  SAME(output.clear_drive_faults);
  SAME(output.torque_target_permille);
  SAME_VECTOR(output.target_bending_rad);
  SAME_VECTOR(output.target_tip_W_m);
  SAME(output.target_distance_m);
  SAME_VECTOR(output.reference.position_rad);
  SAME_VECTOR(output.reference.velocity_radps);
  SAME_VECTOR(output.reference.acceleration_radps2);
  SAME_VECTOR(output.reference_tip_W_m);
  SAME_VECTOR(output.generalised_force_Nm);
  SAME_VECTOR(output.tension_desired_base_N);
  SAME_VECTOR(output.sliding_direction);
  SAME_VECTOR(output.tension_desired_motor_N);
  SAME_VECTOR(output.torque_desired_Nm);
  SAME_VECTOR(output.displacement_desired_m);
  SAME_VECTOR(output.displacement_m);
  SAME_VECTOR(output.tension_measured_N);
  SAME_VECTOR(output.tension_base_estimate_N);
  SAME_VECTOR(output.torque_measured_Nm);
  SAME_VECTOR(output.bending_estimate_rad);
  SAME_VECTOR(output.tip_estimate_W_m);
  SAME_VECTOR(output.orientation_estimate_WT.coeffs());
  SAME(output.commands_accepted);
  SAME(output.commands_refused);
  SAME(output.feedback_missing);
  SAME(output.command_status);
  SAME(timing.wake_latency_ns);
  SAME(timing.feedback_ns);
  SAME(timing.compute_ns);
  SAME(timing.total_ns);
  SAME(timing.deadline_misses);
#undef SAME
#undef SAME_VECTOR
}

namespace {

TEST(Wire, EveryFieldOfACycleComesBackBitForBit) {
  RandomRecords random(kShape, 1);
  tendril_lcm::cycle_t out{}, in{};
  for (int i = 0; i < 500; ++i) {
    const CycleRecord record = random.Next();
    ToMessage(record, kShape, 1, out);
    ASSERT_TRUE(DecodeBytes(Encode(out), in));
    CycleRecord back;
    ASSERT_TRUE(FromMessage(in, back));
    ExpectSameBits(record, back);
    if (HasFailure()) FAIL() << "record " << i;
  }
}

TEST(Wire, StagesBeforeTheFirstCycleAreNaN) {
  tendril_lcm::cycle_t m{};
  ToMessage(CycleRecord{}, kShape, 1, m);
  ASSERT_EQ(m.tension_desired_base_N.size(), 6U);
  for (const double x : m.tension_desired_base_N) EXPECT_TRUE(std::isnan(x));
}

TEST(Wire, AStateTellsTheCovarianceRowByRowAndNaNBeforeThereIsOne) {
  CycleRecord record;
  tendril_lcm::state_t out{}, in{};
  ToMessage(record, kShape, 1, out);
  ASSERT_EQ(out.bending_covariance_rad2.size(), 16U);
  for (const double x : out.bending_covariance_rad2) EXPECT_TRUE(std::isnan(x));

  record.output.bending_covariance_rad2.resize(4, 4);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j)
      record.output.bending_covariance_rad2(i, j) = 10 * std::max(i, j) + std::min(i, j);
  }
  ToMessage(record, kShape, 1, out);
  ASSERT_TRUE(DecodeBytes(Encode(out), in));
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      EXPECT_EQ(in.bending_covariance_rad2[static_cast<std::size_t>(i * in.num_bending + j)],
                record.output.bending_covariance_rad2(i, j));
    }
  }
}

TEST(Wire, FillingAMessageAgainDoesNotMoveItsArrays) {
  RandomRecords random(kShape, 2);
  tendril_lcm::cycle_t m{};
  ToMessage(random.Next(), kShape, 1, m);
  const double* tensions = m.tension_desired_base_N.data();
  ToMessage(random.Next(), kShape, 2, m);
  EXPECT_EQ(m.tension_desired_base_N.data(), tensions);
}

TEST(Decode, AnyShorteningOrLengtheningIsRefused) {
  tendril_lcm::command_bending_t m{};
  m.num_bending = 2;
  m.bending_rad = {1, 2};
  const std::vector<std::uint8_t> good = Encode(m);
  ASSERT_TRUE(DecodeBytes(good, m));
  for (std::size_t n = 0; n < good.size(); ++n) {
    EXPECT_FALSE(DecodeBytes(
        std::vector<std::uint8_t>(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(n)), m))
        << n;
  }
  std::vector<std::uint8_t> longer = good;
  longer.push_back(0);
  EXPECT_FALSE(DecodeBytes(longer, m));
}

TEST(Decode, CountsBeyondTheMessageAreRefusedBeforeMemoryIsReserved) {
  tendril_lcm::command_tension_t m{};
  m.num_tendons = 3;
  m.tension_base_N = {1, 2, 3};
  std::vector<std::uint8_t> bytes = Encode(m);
  for (const std::uint8_t high : {0x7F, 0xFF, 0x10}) {  // 2 billion, negative, 268 million
    bytes[8] = high;
    EXPECT_FALSE(DecodeBytes(bytes, m)) << int{high};
    EXPECT_LT(m.tension_base_N.capacity(), 1000U);
  }
}

TEST(Decode, AnotherMessageIsRefused) {
  tendril_lcm::command_mode_t mode{};
  tendril_lcm::command_tip_t tip{};
  EXPECT_FALSE(DecodeBytes(Encode(mode), tip));
}

TEST(Decode, DamagedMessagesNeverThrow) {
  RandomRecords random(kShape, 3);
  tendril_lcm::state_t m{};
  ToMessage(random.Next(), kShape, 1, m);
  const std::vector<std::uint8_t> good = Encode(m);
  std::mt19937 dice(4);
  for (int i = 0; i < 5000; ++i) {
    std::vector<std::uint8_t> bytes = good;
    for (int k = 0; k < 4; ++k) bytes[8 + dice() % (bytes.size() - 8)] = static_cast<std::uint8_t>(dice());
    tendril_lcm::state_t in{};
    DecodeBytes(bytes, in);
  }
}

TEST(Commands, ValuesAreNotJudgedButSizesAre) {
  tendril_lcm::command_bending_t m{};
  m.sequence = (std::int64_t{1} << 32) + 7;
  m.valid_for_s = 0.5;
  m.num_bending = 3;
  m.bending_rad = {1, std::nan(""), 1e300};
  Command c;
  ASSERT_EQ(FromMessage(m, c), "");
  EXPECT_EQ(c.kind, CommandKind::kBending);
  EXPECT_EQ(c.sequence, 7U);
  EXPECT_EQ(c.sender, 1U);
  EXPECT_EQ(c.valid_for_ns, 500'000'000);
  ASSERT_EQ(c.bending_rad.size(), 3);
  EXPECT_TRUE(std::isnan(c.bending_rad[1]));

  m.num_bending = 9;
  m.bending_rad.assign(9, 0);
  EXPECT_EQ(FromMessage(m, c), "bending_rad has 9 values, at most 8 are possible");
  tendril_lcm::command_mode_t mode{};
  mode.request = 6;
  EXPECT_EQ(FromMessage(mode, c),
            "request 6 is none of 0 arm, 1 disarm, 2 hold, 3 clear, 4 commission, 5 home");
}

TEST(Commands, AValidityThatIsNoNumberIsNone) {
  tendril_lcm::command_tip_t m{};
  Command c;
  m.valid_for_s = std::nan("");
  ASSERT_EQ(FromMessage(m, c), "");
  EXPECT_EQ(c.valid_for_ns, 0);
  m.valid_for_s = std::numeric_limits<double>::infinity();
  ASSERT_EQ(FromMessage(m, c), "");
  EXPECT_GT(c.valid_for_ns, TimeNs{3600} * 24 * 365 * kNsPerS);
}

}  // namespace
}  // namespace tendril::io
