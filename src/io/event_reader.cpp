#include "event_reader.h"

#include <fmt/core.h>
#include <sys/types.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace tendril::io {
namespace {

constexpr std::size_t kReadBuffer_B = std::size_t{1} << 20;
constexpr std::size_t kHeader = 28, kChunk = std::size_t{1} << 16;
constexpr std::array<std::uint8_t, 4> kSync{0xED, 0xA1, 0xDA, 0x01};
constexpr double kApart_us = 60e6;
constexpr std::size_t kPlacesNamed = 4;
constexpr std::uint64_t kZerosNamed = 512;  // a disk's sector; messages hold shorter stretches themselves

std::uint64_t Number(std::span<const std::uint8_t> bytes, std::size_t at, std::size_t size) {
  std::uint64_t number = 0;
  for (const std::uint8_t byte : bytes.subspan(at, size)) number = number << 8 | byte;
  return number;
}

}  // namespace

EventReader::EventReader(const std::string& path) {
  std::error_code ignored;
  const auto type = std::filesystem::status(path, ignored).type();
  // Opening a pipe waits for whoever writes into it.
  if (type == std::filesystem::file_type::fifo || type == std::filesystem::file_type::socket)
    throw std::runtime_error("cannot read log " + path + ": a pipe; name a file");
  file_.reset(std::fopen(path.c_str(), "rb"));
  if (!file_) throw std::runtime_error("cannot read log " + path + ": " + std::strerror(errno));
  std::error_code error;
  size_ = std::filesystem::file_size(path, error);
  if (error) throw std::runtime_error("cannot read log " + path + ": " + error.message());
  std::setvbuf(file_.get(), nullptr, _IOFBF, kReadBuffer_B);
}

bool EventReader::Next() {
  while (Advance()) {
    if (!StampedApart()) {
      CheckNumber();
      Count();
      if (std::none_of(channel_.begin(), channel_.end(), [](unsigned char c) { return std::iscntrl(c); }))
        return true;
      Refuse("has control characters in its channel's name");
      continue;
    }
    places_.push_back(
        {.begin = begin_, .end = end_, .what = "is stamped apart from those around it", .lost = 1});
    last_number_ = number_;
  }
  return false;
}

/// To the next whole event, behind damage.
bool EventReader::Advance() {
  const std::uint64_t at = end_;
  if (at >= size_) return false;
  if (std::string trouble = ReadEvent(at); !trouble.empty()) {
    Place place{.begin = at, .end = FindEvent(at + 1), .what = std::move(trouble)};
    FindZeros(place);
    places_.push_back(std::move(place));
    follows_ = false;
    end_ = places_.back().end;
    if (end_ >= size_ || !ReadEvent(end_).empty()) return false;
    if (events_ > 0 && number_ > last_number_) places_.back().lost = number_ - last_number_ - 1;
    if (events_ == 0) places_.back().lost = number_;
  }
  return true;
}

bool EventReader::StampedApart() {
  const auto apart = [](std::int64_t a_us, std::int64_t b_us) {
    return std::abs(static_cast<double>(a_us) - static_cast<double>(b_us)) > kApart_us;
  };
  if (events_ > 0 && !apart(stamp_us_, last_us_)) return false;
  const auto next = HeaderAt(end_);
  if (!next || !apart(stamp_us_, next->stamp_us)) return false;
  if (events_ > 0) return !apart(last_us_, next->stamp_us);
  const auto after = HeaderAt(next->end);
  return after && !apart(next->stamp_us, after->stamp_us);
}

/// Events are numbered as they are written. Where a number does not follow, events were taken out, another
/// log was put behind, or the number is damaged, which the next event's tells. Logs without numbers have
/// equal ones.
void EventReader::CheckNumber() {
  if (events_ == 0 || !follows_ || number_ == last_number_ + 1 || number_ == last_number_) return;
  Place place{.begin = begin_, .end = begin_, .what = {}};
  const auto next = HeaderAt(end_);
  if (next && next->number == last_number_ + 2) {
    place.what = fmt::format("has number {} where {} follows", number_, last_number_ + 1);
    number_ = last_number_ + 1;
  } else if (number_ < last_number_) {
    place.what = fmt::format("has number {} after {}: another log begins there", number_, last_number_);
  } else {
    place.what = "does not follow the one before it";
    place.lost = number_ - last_number_ - 1;
  }
  places_.push_back(std::move(place));
}

std::optional<EventReader::Header> EventReader::HeaderAt(std::uint64_t offset) {
  std::array<std::uint8_t, kHeader> bytes;
  if (offset + kHeader > size_ || !Read(offset, bytes.data(), kHeader)) return std::nullopt;
  if (!std::equal(kSync.begin(), kSync.end(), bytes.begin())) return std::nullopt;
  return Header{Number(bytes, 4, 8), static_cast<std::int64_t>(Number(bytes, 12, 8)),
                offset + kHeader + Number(bytes, 20, 4) + Number(bytes, 24, 4)};
}

void EventReader::Count() {
  if (follows_ && stamp_us_ > last_us_) seconds_ += 1e-6 * static_cast<double>(stamp_us_ - last_us_);
  follows_ = true;
  last_us_ = stamp_us_;
  last_number_ = number_;
  ++events_;
}

void EventReader::Refuse(const std::string& what) {
  --events_;
  follows_ = false;
  places_.push_back({.begin = begin_, .end = end_, .what = what, .lost = 1});
}

bool EventReader::Read(std::uint64_t offset, void* bytes, std::size_t size) {
  if (position_ != offset && fseeko(file_.get(), static_cast<off_t>(offset), SEEK_SET) != 0) return false;
  const std::size_t got = std::fread(bytes, 1, size, file_.get());
  position_ = offset + got;
  return got == size;
}

/// Makes the event at `offset` the current one; returns why there is none.
std::string EventReader::ReadEvent(std::uint64_t offset) {
  begin_ = offset;
  const std::uint64_t left = size_ - offset;
  std::array<std::uint8_t, kHeader> header;
  if (left < kHeader || !Read(offset, header.data(), kHeader)) return "ends in the middle of its header";
  if (!std::equal(kSync.begin(), kSync.end(), header.begin()))
    return "does not begin like an event of an LCM log";
  const std::uint64_t channel_size = Number(header, 20, 4), data_size = Number(header, 24, 4);
  if (!IsEvent(channel_size, data_size)) return "claims an impossible length";
  if (channel_size + data_size > left - kHeader) return "ends before its data does";
  const std::uint64_t end = offset + kHeader + channel_size + data_size;
  std::array<std::uint8_t, 4> next{};
  const auto ahead = static_cast<std::size_t>(std::min<std::uint64_t>(next.size(), size_ - end));
  if (!Read(end, next.data(), ahead)) return "cannot be read";
  if (!std::equal(next.begin(), next.begin() + static_cast<std::ptrdiff_t>(ahead), kSync.begin()))
    return "is not followed by another";
  channel_.resize(channel_size);
  data_.resize(data_size);
  if (!Read(offset + kHeader, channel_.data(), channel_size) ||
      !Read(offset + kHeader + channel_size, data_.data(), data_size))
    return "cannot be read";
  end_ = end;
  number_ = Number(header, 4, 8);
  stamp_us_ = static_cast<std::int64_t>(Number(header, 12, 8));
  return "";
}

/// Offset of the next whole event, or the end of the file.
std::uint64_t EventReader::FindEvent(std::uint64_t from) {
  for (std::uint64_t at = FindSync(from); at < size_; at = FindSync(at + 1)) {
    if (ReadEvent(at).empty()) return at;
  }
  return size_;
}

std::uint64_t EventReader::FindSync(std::uint64_t from) {
  std::array<std::uint8_t, kChunk> chunk;
  // Chunks overlap by the length of a sync word less one.
  for (std::uint64_t at = from; at + kSync.size() <= size_; at += kChunk - kSync.size() + 1) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(kChunk, size_ - at));
    if (!Read(at, chunk.data(), size)) return size_;
    const auto end = chunk.begin() + static_cast<std::ptrdiff_t>(size);
    const auto found = std::search(chunk.begin(), end, kSync.begin(), kSync.end());
    if (found != end) return at + static_cast<std::uint64_t>(found - chunk.begin());
  }
  return size_;
}

void EventReader::FindZeros(Place& place) {
  std::array<std::uint8_t, kChunk> chunk;
  std::uint64_t begin = place.begin;  // start of the zeros up to the present byte
  for (std::uint64_t at = place.begin; at < place.end; at += kChunk) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(kChunk, place.end - at));
    if (!Read(at, chunk.data(), size)) return;
    for (std::size_t i = 0; i < size; ++i) {
      if (chunk[i] != 0) begin = at + i + 1;
      if (at + i + 1 - begin > place.zeros_end - place.zeros_begin)
        place.zeros_begin = begin, place.zeros_end = at + i + 1;
    }
  }
}

std::string EventReader::Text(const Place& place) const {
  std::string text = fmt::format("the event at byte {} {}", place.begin, place.what);
  if (place.end > place.begin)
    text += fmt::format("; {} bytes are left out{}", place.end - place.begin,
                        place.end == size_ ? ", to the end" : "");
  if (place.zeros_end - place.zeros_begin >= kZerosNamed)
    text += fmt::format(", zeros from byte {} to {}", place.zeros_begin, place.zeros_end);
  if (place.lost > 0) text += fmt::format(", {} event{} lost", place.lost, place.lost == 1 ? "" : "s");
  return text;
}

std::string EventReader::Damage() const {
  if (size_ == 0) return "the file is empty";
  if (places_.empty()) return "";
  std::string text;
  for (std::size_t i = 0; i < std::min(places_.size(), kPlacesNamed); ++i) text += Text(places_[i]) + "; ";
  if (places_.size() > kPlacesNamed) {
    std::uint64_t bytes = 0;
    for (std::size_t i = kPlacesNamed; i < places_.size(); ++i) bytes += places_[i].end - places_[i].begin;
    text += fmt::format("{} more places of {} bytes; ", places_.size() - kPlacesNamed, bytes);
  }
  return text + fmt::format("{} events over {:.4g} s are read", events_, seconds_);
}

}  // namespace tendril::io
