// A Linux SocketCAN interface as a CanPort, classic and FD. Bus-off ends when the kernel restarts
// the controller (README.md: restart-ms) or the link is taken down and up.
#ifndef ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_
#define ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_

#include <string>

#include "firmware/canopen/protocol/can_port.h"

namespace armtrue::posix {

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

  bool send(const canopen::CanFrame& frame) override;
  bool receive(canopen::CanFrame& frame) override;
  canopen::BusState bus_state() override;
  // The kernel restarts the controller, which needs rights that this process may not have.
  void recover() override {}
  canopen::BusCounters counters() const override { return counters_; }
  bool supports_fd() const override { return supports_fd_; }

 private:
  std::string adopt(const std::string& name, int descriptor);
  void take_error_frame(std::uint32_t error_class, const std::uint8_t* data);
  bool is_link_up() const;

  int socket_ = -1;
  std::string interface_;
  bool supports_fd_ = false;
  canopen::BusState state_ = canopen::BusState::kActive;
  bool link_was_down_ = false;  // since the last bus-off
  canopen::BusCounters counters_;
  std::uint32_t kernel_drops_ = 0;
};

}  // namespace armtrue::posix

#endif  // ARMTRUE_FIRMWARE_PORTS_POSIX_SOCKETCAN_PORT_H_
