#include "firmware/ports/posix/socketcan_port.h"

#include <fcntl.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <ctime>
#include <string_view>

#include "firmware/core/fixed/counter.h"

namespace armtrue::posix {
namespace {

using canopen::BusState;
using canopen::CanFrame;

}  // namespace

std::uint64_t host_us() {
  timespec time = {};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<std::uint64_t>(time.tv_sec) * 1'000'000U +
         static_cast<std::uint64_t>(time.tv_nsec) / 1000U;
}

SocketCanPort::~SocketCanPort() {
  if (socket_ >= 0) close(socket_);
}

std::string SocketCanPort::adopt(const std::string& name, int descriptor) {
  int type = 0;
  socklen_t length = sizeof type;
  const int flags = fcntl(descriptor, F_GETFL);
  if (flags < 0 || getsockopt(descriptor, SOL_SOCKET, SO_TYPE, &type, &length) < 0 ||
      type == SOCK_STREAM || fcntl(descriptor, F_SETFL, flags | O_NONBLOCK) < 0) {
    return name + ": expected an open socket that keeps messages apart (SOCK_SEQPACKET)";
  }
  socket_ = descriptor;
  interface_ = name;
  supports_fd_ = true;
  return "";
}

std::string SocketCanPort::open(const std::string& interface) {
  constexpr std::string_view kInherited = "fd:";
  if (interface.starts_with(kInherited)) {
    int descriptor = -1;
    const char* begin = interface.data() + kInherited.size();
    const char* end = interface.data() + interface.size();
    const auto [read, error] = std::from_chars(begin, end, descriptor);
    if (error != std::errc() || read != end) return interface + ": expected fd:NUMBER";
    return adopt(interface, descriptor);
  }
  socket_ = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (socket_ < 0) return interface + ": this kernel has no CAN: " + std::strerror(errno);
  ifreq request = {};
  if (interface.size() >= sizeof(request.ifr_name)) {
    return interface + ": longer than an interface name can be";
  }
  interface_ = interface;
  std::memcpy(request.ifr_name, interface.data(), interface.size());
  if (ioctl(socket_, SIOCGIFINDEX, &request) < 0) return interface + ": no such network interface";
  const int index = request.ifr_ifindex;
  if (ioctl(socket_, SIOCGIFMTU, &request) == 0) supports_fd_ = request.ifr_mtu == CANFD_MTU;
  const int on = 1;
  if (supports_fd_ && setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) < 0) {
    return interface + ": FD frames refused: " + std::strerror(errno);
  }
  const can_err_mask_t errors = CAN_ERR_CRTL | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
  setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  setsockopt(socket_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  confirms_ = setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on) == 0;
  sockaddr_can address = {};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) < 0) {
    return interface + ": cannot bind: " + std::strerror(errno);
  }
  return "";
}

bool SocketCanPort::queue(const CanFrame& frame, const canopen::Command* command) {
  const bool fd = frame.is(canopen::kFrameFd);
  const std::size_t room = fd ? canopen::kFdPayload : canopen::kClassicPayload;
  const bool possible = frame.len <= room && (!fd || canopen::is_valid_fd_length(frame.len)) &&
                        (!fd || supports_fd_) && state_ != BusState::kBusOff;
  const bool is_held_up =
      command != nullptr && no_command_until_us_ != 0 && host_us() < no_command_until_us_;
  Waiting item;
  canfd_frame& raw = item.frame;
  raw.can_id = frame.id;
  if (frame.is(canopen::kFrameExtended)) raw.can_id |= CAN_EFF_FLAG;
  if (frame.is(canopen::kFrameRemote)) raw.can_id |= CAN_RTR_FLAG;
  raw.len = frame.len;
  if (fd && frame.is(canopen::kFrameBitRateSwitch)) raw.flags |= CANFD_BRS;
  if (fd && frame.is(canopen::kFrameErrorState)) raw.flags |= CANFD_ESI;
  item.size = fd ? CANFD_MTU : CAN_MTU;
  if (command != nullptr) item.command = *command;
  if (possible) std::memcpy(raw.data, frame.data, frame.len);
  if (!possible || is_held_up || !to_send_.push(item)) {
    count(counters_.send_refused);
    return false;
  }
  if (hand_over() || in_kernel_ == to_send_.size()) return true;
  std::size_t place = 0;
  to_send_.erase_if([&](const Waiting&) { return ++place == to_send_.size(); });
  count(counters_.send_refused);
  return false;
}

// Gives the kernel the oldest frames. If it has no room, it is asked again with the next frame and
// in every turn of the loop. False if it takes none, because the link is down.
bool SocketCanPort::hand_over() {
  while (in_kernel_ < kInKernel && in_kernel_ < to_send_.size()) {
    const Waiting& item = to_send_[in_kernel_];
    if (write(socket_, &item.frame, item.size) != item.size) {
      return errno == EAGAIN || errno == ENOBUFS;
    }
    if (in_kernel_ == 0) oldest_handed_over_us_ = host_us();
    ++in_kernel_;
    if (!confirms_) note_sent();
  }
  return true;
}

void SocketCanPort::note_sent() {
  Waiting sent;
  if (in_kernel_ == 0 || !to_send_.pop(sent)) return;
  --in_kernel_;
  if (in_kernel_ > 0) oldest_handed_over_us_ = host_us();
  count(counters_.sent);
  if (sent.command) note_command_gone();
}

void SocketCanPort::discard_commands(canopen::Discarded& discarded) {
  bool holds_command = false;
  for (std::size_t k = 0; k < in_kernel_; ++k) holds_command |= to_send_[k].command.has_value();
  holds_command = holds_command && is_stuck();
  const bool is_recalled = holds_command && may_restart_link_ && restart_link();
  // A frame that the kernel keeps is not discarded: it leaves when the bus takes it.
  const std::size_t kept = is_recalled ? 0 : in_kernel_;
  if (is_recalled) {
    in_kernel_ = 0;
    no_command_until_us_ = host_us() + kAttemptUs;
  } else {
    may_restart_link_ = may_restart_link_ && !holds_command;
  }
  std::size_t place = 0;
  to_send_.erase_if([&](const Waiting& item) {
    if (place++ < kept || !item.command) return false;
    discarded.note(*item.command);
    note_command_gone();
    count(counters_.send_refused);
    return true;
  });
}

// Whether it is the bus that takes nothing. If this process was late, a confirmation may be unread,
// or the oldest frame may have come to the kernel only now.
bool SocketCanPort::is_stuck() const {
  std::uint8_t unused = 0;
  const bool is_all_read = recv(socket_, &unused, sizeof unused, MSG_PEEK) < 0;
  return is_all_read && host_us() - oldest_handed_over_us_ >= kStuckUs;
}

// Taking the link down empties the queues of the kernel and of the controller.
bool SocketCanPort::restart_link() {
  ifreq request = {};
  std::memcpy(request.ifr_name, interface_.data(), interface_.size());
  if (ioctl(socket_, SIOCGIFFLAGS, &request) < 0) return false;
  const auto up = request.ifr_flags;
  request.ifr_flags = static_cast<short>(up & ~IFF_UP);
  if (ioctl(socket_, SIOCSIFFLAGS, &request) < 0) return false;
  request.ifr_flags = up;
  if (ioctl(socket_, SIOCSIFFLAGS, &request) < 0) return false;
  int error = 0;  // the socket's, from taking the link down
  socklen_t length = sizeof error;
  getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &length);
  link_was_down_ = true;
  return true;
}

bool SocketCanPort::receive(CanFrame& frame) {
  hand_over();
  for (;;) {
    canfd_frame raw = {};
    iovec piece = {&raw, sizeof raw};
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof(std::uint32_t))] = {};
    msghdr message = {};
    message.msg_iov = &piece;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    const ssize_t size = recvmsg(socket_, &message, 0);
    if (size < 0 && errno == ENETDOWN) {
      link_was_down_ = true;
      while (in_kernel_ > 0) note_sent();  // lost with the link
    }
    if (size != CAN_MTU && size != CANFD_MTU) return false;
    for (cmsghdr* item = CMSG_FIRSTHDR(&message); item != nullptr;
         item = CMSG_NXTHDR(&message, item)) {
      if (item->cmsg_level != SOL_SOCKET || item->cmsg_type != SO_RXQ_OVFL) continue;
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(item), sizeof drops);
      counters_.receive_overruns += drops - kernel_drops_;
      kernel_drops_ = drops;
      while (in_kernel_ > 0) note_sent();  // a confirmation may be among what was dropped
    }
    if ((message.msg_flags & MSG_CONFIRM) != 0) {
      no_command_until_us_ = 0;
      note_sent();
      hand_over();
      continue;
    }
    if ((raw.can_id & CAN_ERR_FLAG) != 0) {
      take_error_frame(raw.can_id & CAN_ERR_MASK, raw.data);
      continue;
    }
    no_command_until_us_ = 0;  // somebody is there
    CanFrame taken;
    const bool extended = (raw.can_id & CAN_EFF_FLAG) != 0;
    taken.id = raw.can_id & (extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    std::uint8_t flags = canopen::kFrameNone;
    if (extended) flags |= canopen::kFrameExtended;
    if ((raw.can_id & CAN_RTR_FLAG) != 0) flags |= canopen::kFrameRemote;
    if (size == CANFD_MTU) {
      flags |= canopen::kFrameFd;
      if ((raw.flags & CANFD_BRS) != 0) flags |= canopen::kFrameBitRateSwitch;
      if ((raw.flags & CANFD_ESI) != 0) flags |= canopen::kFrameErrorState;
    }
    taken.flags = flags;
    taken.len = raw.len;
    std::memcpy(taken.data, raw.data, sizeof taken.data);
    count(counters_.received);
    frame = taken;
    return true;
  }
}

void SocketCanPort::take_error_frame(std::uint32_t error_class, const std::uint8_t* data) {
  if ((error_class & CAN_ERR_BUSOFF) != 0) {
    if (state_ != BusState::kBusOff) count(counters_.bus_off_entries);
    state_ = BusState::kBusOff;
    link_was_down_ = false;
    return;
  }
  if ((error_class & CAN_ERR_RESTARTED) != 0) state_ = BusState::kActive;
  if ((error_class & CAN_ERR_CRTL) == 0 || state_ == BusState::kBusOff) return;
  const std::uint8_t status = data[1];
  if ((status & (CAN_ERR_CRTL_RX_OVERFLOW)) != 0) count(counters_.receive_overruns);
  if ((status & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
    state_ = BusState::kPassive;
  } else if ((status & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
    state_ = BusState::kWarning;
  } else if ((status & CAN_ERR_CRTL_ACTIVE) != 0) {
    state_ = BusState::kActive;
  }
}

BusState SocketCanPort::bus_state() {
  // Taking the link up restarts the controller, but no error frame reports that.
  if (state_ == BusState::kBusOff && link_was_down_ && is_link_up()) state_ = BusState::kActive;
  return state_;
}

bool SocketCanPort::is_link_up() const {
  ifreq request = {};
  std::memcpy(request.ifr_name, interface_.data(), interface_.size());
  return ioctl(socket_, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

}  // namespace armtrue::posix
