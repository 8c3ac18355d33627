// Reads the events of an LCM log one by one, skipping damage. Knows the file format; nothing of what the
// messages mean.
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tendril::io {

// Limits beyond which data count as damage, since any program may send any message, even on a channel without
// a name.
constexpr std::uint64_t kMaxChannel = 1000;
constexpr std::uint64_t kMaxData = std::uint64_t{1} << 28;  // LCM's largest message

constexpr bool IsEvent(std::uint64_t channel_size, std::uint64_t data_size) {
  return channel_size >= 1 && channel_size <= kMaxChannel && data_size <= kMaxData;
}

/// From one report of progress to the next, of whoever reads a whole log.
inline constexpr std::uint64_t kEventsAReport = 4096;

/// Every length is checked against the file, because LCM's own reader trusts them and skips damage silently.
/// An event counts only when another follows it or the file ends there: an event overwritten in part may have
/// an intact header. One that is stamped far from those around it, which agree, is damage too: a log is
/// written as time goes on, and a clock that is set changes all that follow.
class EventReader {
 public:
  /// Throws std::runtime_error naming the path when it cannot be read.
  explicit EventReader(const std::string& path);

  /// Advances to the next complete event; false at the end of the file.
  bool Next();
  const std::string& channel() const { return channel_; }
  const std::vector<std::uint8_t>& data() const { return data_; }
  /// Offset of the event in the file.
  std::uint64_t offset() const { return begin_; }
  /// When the event was recorded, in microseconds.
  std::int64_t stamp_us() const { return stamp_us_; }
  /// Bytes of the file.
  std::uint64_t size() const { return size_; }

  /// Marks the event as damage although it is complete: its message is invalid, for the reason given ("is no
  /// ...").
  void Refuse(const std::string& what);
  /// Empty, or one line: the damaged places with their offsets, and how much of the log is read.
  std::string Damage() const;

 private:
  struct Place {
    std::uint64_t begin = 0, end = 0;  // bytes left out
    std::string what;
    std::uint64_t zeros_begin = 0, zeros_end = 0;  // the longest run of zeros in it
    std::uint64_t lost = 0;                        // lost events, by their numbers in the file; 0: not known
  };
  struct FileCloser {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };

  /// An event's number, when it was recorded, and where it ends.
  struct Header {
    std::uint64_t number = 0;
    std::int64_t stamp_us = 0;
    std::uint64_t end = 0;
  };

  bool Advance();
  bool StampedApart();
  void CheckNumber();
  std::optional<Header> HeaderAt(std::uint64_t offset);
  bool Read(std::uint64_t offset, void* bytes, std::size_t size);
  std::string ReadEvent(std::uint64_t offset);
  std::uint64_t FindEvent(std::uint64_t from);
  std::uint64_t FindSync(std::uint64_t from);
  void FindZeros(Place& place);
  void Count();
  std::string Text(const Place& place) const;

  std::unique_ptr<std::FILE, FileCloser> file_;
  std::uint64_t size_ = 0, position_ = 0;
  // The current event.
  std::uint64_t begin_ = 0, end_ = 0, number_ = 0;
  std::int64_t stamp_us_ = 0;
  std::string channel_;
  std::vector<std::uint8_t> data_;
  // Read and skipped parts.
  std::vector<Place> places_;
  std::uint64_t events_ = 0, last_number_ = 0;
  std::int64_t last_us_ = 0;
  double seconds_ = 0;
  bool follows_ = false;  // directly follows an event that counts
};

}  // namespace tendril::io
