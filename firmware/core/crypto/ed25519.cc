#include "firmware/core/crypto/ed25519.h"

#include "monocypher.h"

namespace armtrue {
namespace {

// The hash of nonce point, key and message, reduced to a scalar (RFC 8032, 5.1.6 step 4). Not
// inlined, so that the hash state is not on the stack beside the curve arithmetic.
[[gnu::noinline]] std::array<std::uint8_t, 32> challenge(std::span<const std::uint8_t> nonce_point,
                                                         std::span<const std::uint8_t> public_key,
                                                         std::span<const std::uint8_t> message) {
  Sha512 hash;
  hash.update(nonce_point);
  hash.update(public_key);
  hash.update(message);
  const Sha512Digest digest = hash.finish();
  std::array<std::uint8_t, 32> scalar;
  crypto_eddsa_reduce(scalar.data(), digest.data());
  return scalar;
}

// Secret scalar and the prefix of the nonce (RFC 8032, 5.1.5).
struct ExpandedKey {
  std::array<std::uint8_t, 32> scalar;
  std::array<std::uint8_t, 32> prefix;
};

ExpandedKey expand(std::span<const std::uint8_t, 32> seed) {
  Sha512 hash;
  hash.update(seed);
  const Sha512Digest digest = hash.finish();
  ExpandedKey key;
  crypto_eddsa_trim_scalar(key.scalar.data(), digest.data());
  for (std::size_t i = 0; i < key.prefix.size(); ++i) {
    key.prefix[i] = digest[32 + i];
  }
  return key;
}

}  // namespace

bool verify_ed25519(std::span<const std::uint8_t, 64> signature,
                    std::span<const std::uint8_t, 32> public_key,
                    std::span<const std::uint8_t> message) {
  const std::array<std::uint8_t, 32> hash = challenge(signature.first<32>(), public_key, message);
  return crypto_eddsa_check_equation(signature.data(), public_key.data(), hash.data()) == 0;
}

std::array<std::uint8_t, 32> public_key_ed25519(std::span<const std::uint8_t, 32> seed) {
  const ExpandedKey key = expand(seed);
  std::array<std::uint8_t, 32> public_key;
  crypto_eddsa_scalarbase(public_key.data(), key.scalar.data());
  return public_key;
}

std::array<std::uint8_t, 64> sign_ed25519(std::span<const std::uint8_t, 32> seed,
                                          std::span<const std::uint8_t> message) {
  const ExpandedKey key = expand(seed);
  const std::array<std::uint8_t, 32> public_key = public_key_ed25519(seed);
  Sha512 hash;
  hash.update(key.prefix);
  hash.update(message);
  const Sha512Digest digest = hash.finish();
  std::array<std::uint8_t, 32> nonce;
  crypto_eddsa_reduce(nonce.data(), digest.data());

  std::array<std::uint8_t, 64> signature;
  crypto_eddsa_scalarbase(signature.data(), nonce.data());
  const std::array<std::uint8_t, 32> hash_scalar =
      challenge(std::span(signature).first(32), public_key, message);
  crypto_eddsa_mul_add(signature.data() + 32, hash_scalar.data(), key.scalar.data(), nonce.data());
  return signature;
}

}  // namespace armtrue
