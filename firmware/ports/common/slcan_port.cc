#include "firmware/ports/common/slcan_port.h"

#include <utility>

#include "firmware/core/fixed/counter.h"
#include "firmware/ports/common/classic_frame.h"

namespace armtrue::ports {
namespace {

constexpr std::uint8_t kEnd = '\r';
constexpr std::uint8_t kBell = 7;

using Line = std::span<const std::uint8_t>;

// Value of a hexadecimal digit; 16 for any other character.
std::uint32_t digit_value(std::uint8_t character) {
  if (character >= '0' && character <= '9') return character - std::uint32_t{'0'};
  if (character >= 'A' && character <= 'F') return character - std::uint32_t{'A'} + 10;
  if (character >= 'a' && character <= 'f') return character - std::uint32_t{'a'} + 10;
  return 16;
}

bool parse_hex(Line digits, std::uint32_t& value) {
  value = 0;
  for (const std::uint8_t character : digits) {
    const std::uint32_t digit = digit_value(character);
    if (digit > 15) return false;
    value = value << 4 | digit;
  }
  return true;
}

bool is_frame(std::uint8_t command) {
  return command == 't' || command == 'T' || command == 'r' || command == 'R';
}

// Reads a line that begins with one of t, T, r, R.
bool parse_frame(Line line, canopen::CanFrame& frame) {
  const bool extended = line[0] == 'T' || line[0] == 'R';
  const bool remote = line[0] == 'r' || line[0] == 'R';
  const std::size_t id_digits = extended ? 8 : 3;
  if (line.size() < 1 + id_digits + 1) return false;

  canopen::CanFrame parsed;
  std::uint32_t length = 0;
  if (!parse_hex(line.subspan(1, id_digits), parsed.id) ||
      !parse_hex(line.subspan(1 + id_digits, 1), length) || length > canopen::kClassicPayload) {
    return false;
  }
  parsed.len = static_cast<std::uint8_t>(length);
  if (extended) parsed.flags |= canopen::kFrameExtended;
  if (remote) parsed.flags |= canopen::kFrameRemote;
  const Line payload = line.subspan(1 + id_digits + 1);
  if (!is_classic(parsed) || payload.size() != (remote ? 0 : 2 * length)) return false;
  for (std::size_t i = 0; 2 * i < payload.size(); ++i) {
    std::uint32_t byte = 0;
    if (!parse_hex(payload.subspan(2 * i, 2), byte)) return false;
    parsed.data[i] = static_cast<std::uint8_t>(byte);
  }
  frame = parsed;
  return true;
}

void append_hex(std::uint32_t value, std::size_t digits, std::uint8_t*& to) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  for (std::size_t i = digits; i > 0; --i) {
    *to = static_cast<std::uint8_t>(kDigits[value >> (4 * (i - 1)) & 15U]);
    ++to;
  }
}

}  // namespace

bool SlcanPort::queue(const canopen::CanFrame& frame, const canopen::Command* command) {
  std::array<std::uint8_t, kLongestLine + 1> text;
  std::uint8_t* to = text.data();
  if (channel_ != Channel::kClosed && is_classic(frame)) {
    const bool extended = frame.is(canopen::kFrameExtended);
    const bool remote = frame.is(canopen::kFrameRemote);
    const char data_command = extended ? 'T' : 't';
    const char remote_command = extended ? 'R' : 'r';
    *to = static_cast<std::uint8_t>(remote ? remote_command : data_command);
    ++to;
    append_hex(frame.id, extended ? 8 : 3, to);
    append_hex(frame.len, 1, to);
    for (std::size_t i = 0; i < (remote ? 0U : frame.len); ++i) append_hex(frame.data[i], 2, to);
    *to = kEnd;
    ++to;
  }
  const auto size = static_cast<std::size_t>(to - text.data());
  if (size == 0 || size > stream_.writable()) {
    count(counters_.send_refused);
    return false;
  }
  stream_.write(std::span(text).first(size));
  count(counters_.sent);
  if (command != nullptr) note_command_gone();
  return true;
}

bool SlcanPort::receive(canopen::CanFrame& frame) {
  std::uint8_t byte = 0;
  while (stream_.read(byte)) {
    if (byte == '\n') continue;  // terminals send it after CR
    if (byte != kEnd) {
      if (line_length_ < line_.size()) {
        line_[line_length_] = byte;
        ++line_length_;
      } else {
        line_too_long_ = true;
      }
      continue;
    }
    const Line line = Line(line_).first(line_length_);
    line_length_ = 0;
    if (std::exchange(line_too_long_, false)) {
      reply(std::array{kBell});
    } else if (take_line(line, frame)) {
      return true;
    }
  }
  return false;
}

// Returns true where the line is a frame.
bool SlcanPort::take_line(Line line, canopen::CanFrame& frame) {
  if (line.empty()) {
    reply(std::array{kEnd});
    return false;
  }
  if (!is_frame(line[0])) {
    if (!take_command(line)) reply(std::array{kBell});
    return false;
  }
  if (channel_ != Channel::kOpen || !parse_frame(line, frame)) {
    reply(std::array{kBell});
    return false;
  }
  const bool extended = frame.is(canopen::kFrameExtended);
  reply(std::array{static_cast<std::uint8_t>(extended ? 'Z' : 'z'), kEnd});
  count(counters_.received);
  return true;
}

bool SlcanPort::take_command(Line line) {
  static constexpr std::uint8_t kVersion[] = {'V', '1', '0', '1', '3', kEnd};
  static constexpr std::uint8_t kSerial[] = {'N', '0', '0', '0', '0', kEnd};
  static constexpr std::uint8_t kStatus[] = {'F', '0', '0', kEnd};
  const std::size_t arguments = line.size() - 1;
  switch (line[0]) {
    case 'S':
      if (channel_ != Channel::kClosed || arguments != 1 || line[1] < '0' || line[1] > '8') {
        return false;
      }
      break;
    case 'O':
    case 'L':
      if (channel_ != Channel::kClosed || arguments != 0) return false;
      channel_ = line[0] == 'O' ? Channel::kOpen : Channel::kListening;
      break;
    case 'C':
      if (arguments != 0) return false;
      channel_ = Channel::kClosed;
      break;
    case 'V':
      reply(kVersion);
      return true;
    case 'N':
      reply(kSerial);
      return true;
    case 'F':
      reply(kStatus);
      return true;
    default:
      return false;
  }
  reply(std::array{kEnd});
  return true;
}

// A reply that finds no room is lost, as on any serial line without flow control.
void SlcanPort::reply(Line text) {
  if (text.size() <= stream_.writable()) stream_.write(text);
}

}  // namespace armtrue::ports
