// Ed25519 signatures (RFC 8032, 5.1): SHA-512 of our own around Monocypher's curve arithmetic,
// whose own EdDSA hashes with BLAKE2b and would not be Ed25519.
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

// True if `signature` (64 bytes) of `message` was made by the owner of `public_key` (32 bytes).
// Takes the same time for any key and signature of a message of the same length, up to the early
// end when the public key is not a point of the curve.
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
