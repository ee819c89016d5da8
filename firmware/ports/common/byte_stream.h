// A stream of bytes both ways: a serial port.
#ifndef ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_STREAM_H_
#define ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_STREAM_H_

#include <cstddef>
#include <cstdint>
#include <span>

namespace armtrue::ports {

// No call blocks.
class ByteStream {
 public:
  // Takes the oldest received byte. False if there is none.
  virtual bool read(std::uint8_t& byte) = 0;

  // Bytes that write() takes now.
  virtual std::size_t writable() const = 0;

  // Queues `bytes`; there must be room for all of them.
  virtual void write(std::span<const std::uint8_t> bytes) = 0;

 protected:
  ~ByteStream() = default;
};

}  // namespace armtrue::ports

#endif  // ARMTRUE_FIRMWARE_PORTS_COMMON_BYTE_STREAM_H_
