// Ed25519 signatures (RFC 8032, 5.1): our SHA-512 with Monocypher's curve arithmetic. Monocypher's
// own EdDSA hashes with BLAKE2b and is therefore not Ed25519.
#ifndef ARMTRUE_FIRMWARE_CORE_CRYPTO_ED25519_H_
#define ARMTRUE_FIRMWARE_CORE_CRYPTO_ED25519_H_

#include <array>
#include <cstdint>
#include <span>

namespace armtrue {

using Sha512Digest = std::array<std::uint8_t, 64>;

// SHA-512 (FIPS 180-4), fed in pieces.
class Sha512 {
 public:
  Sha512();
  void update(std::span<const std::uint8_t> bytes);
  Sha512Digest finish();

 private:
  void compress();

  std::array<std::uint64_t, 8> state_;
  std::array<std::uint8_t, 128> block_ = {};
  std::uint64_t length_ = 0;  // bytes so far
};

// True if `signature` (64 bytes) of `message` was made by the owner of `public_key` (32 bytes). The
// time depends on the length of the message but not on key or signature, except for an early end if
// the public key is not a point of the curve.
bool verify_ed25519(std::span<const std::uint8_t, 64> signature,
                    std::span<const std::uint8_t, 32> public_key,
                    std::span<const std::uint8_t> message);

// The public key of a 32-byte secret seed, and a signature with it. Host tools only; not linked
// into a device.
std::array<std::uint8_t, 32> public_key_ed25519(std::span<const std::uint8_t, 32> seed);
std::array<std::uint8_t, 64> sign_ed25519(std::span<const std::uint8_t, 32> seed,
                                          std::span<const std::uint8_t> message);

}  // namespace armtrue

#endif  // ARMTRUE_FIRMWARE_CORE_CRYPTO_ED25519_H_
