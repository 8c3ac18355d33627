// What arbitrary bytes from the bus may do to the stack: nothing. Each target takes bytes as frames, and
// aborts when a property of the stack does not hold. Run by libFuzzer and, with made-up bytes, by the tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace tendril::canopen::test {

// Each returns how many frames it made of the bytes.

/// SDO requests against whatever a server may answer: no write outside the buffer, an end state only for a
/// reason, an upload's size never above the capacity.
int FuzzSdoClient(std::span<const std::uint8_t> bytes);
/// NMT, heartbeat, EMCY, SDO and PDO decoders: what decodes encodes to the same frame.
int FuzzDecoders(std::span<const std::uint8_t> bytes);
/// A master with three drives under a storm of frames: no torque to a drive that was not seen in operation
/// enabled, and never without a request.
int FuzzMaster(std::span<const std::uint8_t> bytes);

}  // namespace tendril::canopen::test
