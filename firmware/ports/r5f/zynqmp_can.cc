#include "firmware/ports/r5f/zynqmp_can.h"

namespace armtrue::r5f {
namespace {

using ports::ClassicFrame;

// Identifier word of the hardware (UG1087, TXFIFO_ID).
constexpr std::uint32_t kHighShift =
    21;  // eleven bits: all of a base identifier, the top of an extended one
constexpr std::uint32_t kSubstituteRemote = 1U << 20;  // in a base frame the remote bit
constexpr std::uint32_t kExtended = 1U << 19;
constexpr std::uint32_t kLowShift = 1;  // eighteen bits
constexpr std::uint32_t kLowBits = 18;
constexpr std::uint32_t kLowMask = (1U << kLowBits) - 1;
constexpr std::uint32_t kExtendedRemote = 1U << 0;

// Identifier word of the emulator: SocketCAN's can_id.
constexpr std::uint32_t kSocketExtended = 1U << 31;
constexpr std::uint32_t kSocketRemote = 1U << 30;

std::uint32_t hardware_id(const ClassicFrame& frame, bool extended, bool remote) {
  if (!extended) return frame.id << kHighShift | (remote ? kSubstituteRemote : 0);
  return (frame.id >> kLowBits) << kHighShift | kSubstituteRemote | kExtended |
         (frame.id & kLowMask) << kLowShift | (remote ? kExtendedRemote : 0);
}

std::uint32_t reversed(std::uint32_t word) {
  return word >> 24 | (word >> 8 & 0xFF00U) | (word << 8 & 0xFF0000U) | word << 24;
}

}  // namespace

FifoWords to_fifo(const ClassicFrame& frame, FifoLayout layout) {
  const bool extended = frame.is(canopen::kFrameExtended);
  const bool remote = frame.is(canopen::kFrameRemote);
  const std::array<std::uint32_t, 2> data = frame.words();
  const std::uint32_t dlc = static_cast<std::uint32_t>(frame.len) << zynqmp_can::kDlcShift;
  if (layout == FifoLayout::kEmulated) {
    return {frame.id | (extended ? kSocketExtended : 0) | (remote ? kSocketRemote : 0), dlc,
            data[0], data[1]};
  }
  return {hardware_id(frame, extended, remote), dlc, reversed(data[0]), reversed(data[1])};
}

ClassicFrame from_fifo(const FifoWords& words, FifoLayout layout) {
  const bool emulated = layout == FifoLayout::kEmulated;
  const bool extended = (words.id & (emulated ? kSocketExtended : kExtended)) != 0;
  const std::uint32_t remote_bit = emulated   ? kSocketRemote
                                   : extended ? kExtendedRemote
                                              : kSubstituteRemote;
  ClassicFrame frame;
  if (emulated) {
    frame.id = words.id & (extended ? 0x1FFFFFFFU : 0x7FFU);
  } else {
    frame.id = words.id >> kHighShift;
    if (extended) frame.id = frame.id << kLowBits | (words.id >> kLowShift & kLowMask);
  }
  if (extended) frame.flags |= canopen::kFrameExtended;
  if ((words.id & remote_bit) != 0) frame.flags |= canopen::kFrameRemote;
  frame.set_payload(words.dlc >> zynqmp_can::kDlcShift,
                    {emulated ? words.data1 : reversed(words.data1),
                     emulated ? words.data2 : reversed(words.data2)});
  return frame;
}

}  // namespace armtrue::r5f
