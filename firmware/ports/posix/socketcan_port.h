// A Linux SocketCAN interface as a CanPort, classic and FD. Bus-off ends when the kernel restarts
// the controller (README.md: restart-ms) or the link is taken down and up.
//
// Frames wait in this process, and at most kInKernel of them in the kernel, which says when one has
// left (CAN_RAW_RECV_OWN_MSGS) and gives none back: to discard a command there, the link is taken
// down and up, for which the process needs CAP_NET_ADMIN.
#ifndef ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_
#define ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_

#include <linux/can.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "firmware/canopen/protocol/can_port.h"
#include "firmware/ports/common/queue.h"

namespace armtrue::posix {

// The host's monotonic clock.
std::uint64_t host_us();

class SocketCanPort final : public canopen::CanPort {
 public:
  SocketCanPort() = default;
  ~SocketCanPort();
  SocketCanPort(const SocketCanPort&) = delete;
  SocketCanPort& operator=(const SocketCanPort&) = delete;

  // Binds to `interface`. Empty if it worked, else one sentence that names the interface.
  // "fd:N": file descriptor N, inherited from the parent process, is a socket whose messages are
  // can_frame or canfd_frame: a bus without the kernel's CAN.
  std::string open(const std::string& interface);

  // For poll(2).
  int descriptor() const { return socket_; }

  void discard_commands(canopen::Discarded& discarded) override;
  bool receive(canopen::CanFrame& frame) override;
  canopen::BusState bus_state() override;
  // The kernel restarts the controller, which needs rights that this process may not have.
  void recover() override {}
  canopen::BusCounters counters() const override { return counters_; }
  bool supports_fd() const override { return supports_fd_; }

 protected:
  bool queue(const canopen::CanFrame& frame, const canopen::Command* command) override;

 private:
  static constexpr std::size_t kQueue = 64;
  static constexpr std::size_t kInKernel = 3;
  // While the bus takes nothing, one attempt a second to send a command: each ends with the link
  // taken down and up.
  static constexpr std::uint64_t kAttemptUs = 1'000'000;

  // A frame that the kernel has had for this long is stuck, unless a confirmation is unread.
  static constexpr std::uint64_t kStuckUs = 10'000;

  struct Waiting {
    canfd_frame frame = {};
    std::uint8_t size = 0;  // CAN_MTU or CANFD_MTU
    std::optional<canopen::Command> command;
  };

  std::string adopt(const std::string& name, int descriptor);
  bool hand_over();
  void note_sent();
  bool is_stuck() const;
  bool restart_link();
  void take_error_frame(std::uint32_t error_class, const std::uint8_t* data);
  bool is_link_up() const;

  int socket_ = -1;
  std::string interface_;
  bool supports_fd_ = false;
  bool confirms_ = false;  // the kernel says when a frame has left
  ports::Queue<Waiting, kQueue> to_send_;
  std::size_t in_kernel_ = 0;  // the oldest ones of to_send_
  // When the oldest frame in the kernel became the next to leave: it was handed over then, or the
  // frame before it left then, whichever was later.
  std::uint64_t oldest_handed_over_us_ = 0;
  bool may_restart_link_ = true;
  std::uint64_t no_command_until_us_ = 0;
  canopen::BusState state_ = canopen::BusState::kActive;
  bool link_was_down_ = false;  // since the last bus-off
  canopen::BusCounters counters_;
  std::uint32_t kernel_drops_ = 0;
};

}  // namespace armtrue::posix

#endif  // ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_
