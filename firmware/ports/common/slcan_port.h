// A CAN port over a serial line, in the text protocol of the Lawicel CAN232 (its manual, version
// 3). python-can speaks it as `slcan`, Linux as `slcand`.
//
//   line (ends in CR)       meaning                     reply
//   S0 ... S8               bit rate                    CR; BEL while open
//   O, L, C                 open, open listening, close CR
//   tIIILDD... TIIIIIIIIL.. data frame, 11 or 29 bits   z CR, Z CR; BEL while closed or listening
//   rIIIL      RIIIIIIIIL   remote frame                likewise
//   V, N, F                 version, serial, status     V1013 CR, N0000 CR, F00 CR
//   anything else                                       BEL
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_SLCAN_PORT_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_SLCAN_PORT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/ports/common/byte_stream.h"

namespace armtrue::ports {

class SlcanPort final : public canopen::CanPort {
 public:
  // `stream` is not owned and must outlive the port.
  explicit SlcanPort(ByteStream& stream) : stream_(stream) {}

  // The line takes what is written, whether or not somebody listens: no command ever waits.
  void discard_commands(canopen::Discarded&) override {}
  bool receive(canopen::CanFrame& frame) override;
  // A serial line is point-to-point and never bus-off.
  canopen::BusState bus_state() override { return canopen::BusState::kActive; }
  void recover() override {}
  canopen::BusCounters counters() const override { return counters_; }

 protected:
  // Refuses frames while the other side has closed the channel.
  bool queue(const canopen::CanFrame& frame, const canopen::Command* command) override;

 private:
  enum class Channel : std::uint8_t { kClosed, kOpen, kListening };

  // The longest line: T, eight digits of identifier, length, sixteen of data.
  static constexpr std::size_t kLongestLine = 1 + 8 + 1 + 16;

  bool take_line(std::span<const std::uint8_t> line, canopen::CanFrame& frame);
  bool take_command(std::span<const std::uint8_t> line);
  void reply(std::span<const std::uint8_t> text);

  ByteStream& stream_;
  std::array<std::uint8_t, kLongestLine> line_ = {};
  std::size_t line_length_ = 0;
  bool line_too_long_ = false;
  // Open at start, unlike in an adapter: the node may restart without its client.
  Channel channel_ = Channel::kOpen;
  canopen::BusCounters counters_;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_SLCAN_PORT_H_
