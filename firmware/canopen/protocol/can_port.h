// Interface between the portable node and a CAN controller: one frame type and one port class.
// Every port (SocketCAN, bxCAN, ZynqMP CAN, SLCAN, the simulated bus) implements CanPort; the node
// does not depend on which one it uses.
#ifndef ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CAN_PORT_H_
#define ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CAN_PORT_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace armtrue::canopen {

// Largest payload of a classic and of an FD frame (ISO 11898-1:2015, 10.4.2.3).
inline constexpr std::size_t kClassicPayload = 8;
inline constexpr std::size_t kFdPayload = 64;

// Frame flags, combined with bitwise or. A frame without kFrameFd is a classic frame.
enum FrameFlags : std::uint8_t {
  kFrameNone = 0,
  kFrameExtended = 1U << 0,       // 29-bit identifier
  kFrameRemote = 1U << 1,         // remote transmission request (classic only, no payload)
  kFrameFd = 1U << 2,             // CAN FD frame
  kFrameBitRateSwitch = 1U << 3,  // FD only: data phase at the fast rate
  kFrameErrorState = 1U << 4,     // FD only: error state indicator of the sender
};

// One frame as it stands on the bus. `id` is right-aligned (bits 10..0, or 28..0 when extended).
// Bytes of `data` at and beyond `len` have no meaning.
struct CanFrame {
  std::uint32_t id = 0;
  std::uint8_t flags = kFrameNone;
  std::uint8_t len = 0;  // payload bytes: 0..8, FD also 12, 16, 20, 24, 32, 48, 64
  std::uint8_t data[kFdPayload] = {};

  constexpr bool is(FrameFlags flag) const { return (flags & flag) != 0; }
};

// Whether an FD frame can carry `len` bytes exactly; anything else has to be padded by the sender.
constexpr bool is_valid_fd_length(std::size_t len) {
  return len <= 8 || len == 12 || len == 16 || len == 20 || len == 24 || len == 32 || len == 48 ||
         len == 64;
}

// Error confinement state of a controller (ISO 11898-1, 12.1.4).
enum class BusState : std::uint8_t { kActive, kWarning, kPassive, kBusOff };

// Running counts since start; they saturate at their maximum rather than wrap.
struct BusCounters {
  std::uint32_t received = 0;
  std::uint32_t sent = 0;
  std::uint32_t receive_overruns = 0;  // frames lost because they were not read in time
  std::uint32_t send_refused = 0;      // send() calls that found the queue full or the bus off,
                                       // and commands discarded
  std::uint32_t bus_off_entries = 0;
};

// A command to drives as its sender knows it: the axes (bit k: axis k) whose targets or offsets it
// carries, and the cycle that computed them, modulo 256.
struct Command {
  std::uint8_t axes = 0;
  std::uint8_t cycle = 0;
};

// Outputs that ports discarded: for each axis in `axes`, the cycle of the oldest one. Their cycles
// are few enough to compare modulo 256: see CommandBacklog.
struct Discarded {
  std::uint8_t axes = 0;
  std::array<std::uint8_t, 8> cycle = {};

  void note(Command command) {
    for (std::size_t k = 0; k < cycle.size(); ++k) {
      if ((command.axes >> k & 1U) == 0) continue;
      const auto older = static_cast<std::int8_t>(command.cycle - cycle[k]);
      if ((axes >> k & 1U) == 0 || older < 0) cycle[k] = command.cycle;
    }
    axes |= command.axes;
  }
};

// Running counts of commands; they wrap.
struct CommandCounts {
  std::uint32_t accepted = 0;
  std::uint32_t gone = 0;  // of those, left or discarded
};

// A CAN controller. No call blocks, allocates or throws. Frames with equal identifiers leave in the
// order in which they were queued. All calls of one port come from one context; a driver that is
// fed by interrupts protects its own queues.
class CanPort {
 public:
  // Queues a frame for transmission. Returns false, having queued nothing, if the queue is full,
  // the controller is bus-off, or the frame is one that this controller cannot send (FD on a
  // classic controller, invalid length). The caller decides whether to try again.
  bool send(const CanFrame& frame) { return queue(frame, nullptr); }

  // The same with a frame that drives act on. It may leave until discard_commands() withdraws it:
  // BusWatch does so before it is older than its limit.
  bool send_command(const CanFrame& frame, Command command) {
    const bool is_accepted = queue(frame, &command);
    if (is_accepted) ++commands_accepted_;
    return is_accepted;
  }

  CommandCounts commands() const { return {commands_accepted_, commands_gone_}; }

  // Discards the commands that have not left, and notes them in `discarded`; other frames stay. One
  // that is on the wire at this moment may still leave.
  virtual void discard_commands(Discarded& discarded) = 0;

  // Takes the oldest received frame. Returns false if there is none; `frame` is then unchanged.
  virtual bool receive(CanFrame& frame) = 0;

  // Whether frames wait in the queue for the controller. Senders of frames that can wait then queue
  // no more. False if a port does not know.
  virtual bool has_backlog() { return false; }

  // Frames, 1 to 127, that may arrive back to back without loss: the largest block size (segments)
  // that an SDO block download asks for.
  virtual std::uint8_t longest_burst() const { return 127; }

  virtual BusState bus_state() = 0;

  // Begins the recovery from bus-off (the 128 × 11 recessive bits run in hardware). Discards what
  // is queued for transmission; call discard_commands() before it. No effect otherwise, nor
  // while a recovery runs: the node calls it until it succeeds. bus_state() leaves kBusOff when the
  // controller takes part in traffic again.
  virtual void recover() = 0;

  virtual BusCounters counters() const = 0;

  // Whether send() accepts frames flagged kFrameFd.
  virtual bool supports_fd() const { return false; }

 protected:
  // Implements send() and send_command(). `command`: nullptr for other frames; not kept.
  virtual bool queue(const CanFrame& frame, const Command* command) = 0;
  // A command has left or was discarded. May be called by the driver's interrupt.
  void note_command_gone() { commands_gone_ = commands_gone_ + 1; }

  // Ports are static objects and never deleted through this type: a virtual destructor would pull
  // operator delete into a heap-free image.
  ~CanPort() = default;

 private:
  std::uint32_t commands_accepted_ = 0;
  volatile std::uint32_t commands_gone_ = 0;  // written by interrupts
};

}  // namespace armtrue::canopen

#endif  // ARMTRUE_FIRMWARE_CANOPEN_PROTOCOL_CAN_PORT_H_
