// The robot's end of lgmpc's UDP link (packets of version 3, see lgmpc/hardware/packets.py) in C++17, without libraries.
//   g++ -std=c++17 -O2 robot_end.cpp -o robot_end && ./robot_end PORT SECRET_FILE JOINTS TICKS
// A robot's program replaces `measure` and `apply`. For a little-endian machine. No watchdog: a robot's has to have one.
#include <arpa/inet.h>
#include <poll.h>
#include <sys/random.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

using Bytes = std::string;

Bytes sha256(Bytes text) {  // FIPS 180-4; its constants are roots of the first primes
  auto root = [](int prime, double power) {
    long double value = powl(prime, power);
    return static_cast<uint32_t>((value - floorl(value)) * 4294967296.0L);
  };
  std::vector<int> primes;
  for (int n = 2; primes.size() < 64; ++n)
    if (std::none_of(primes.begin(), primes.end(), [n](int p) { return n % p == 0; })) primes.push_back(n);
  uint32_t state[8], k[64];
  for (int i = 0; i < 8; ++i) state[i] = root(primes[i], 0.5L);
  for (int i = 0; i < 64; ++i) k[i] = static_cast<uint32_t>((cbrtl(primes[i]) - floorl(cbrtl(primes[i]))) * 4294967296.0L);
  uint64_t bits = 8 * text.size();
  text += '\x80';
  text.resize((text.size() + 8 + 63) / 64 * 64 - 8, '\0');
  for (int i = 7; i >= 0; --i) text += static_cast<char>(bits >> 8 * i);
  auto turn = [](uint32_t x, int n) { return x >> n | x << (32 - n); };
  for (size_t at = 0; at < text.size(); at += 64) {
    uint32_t w[64], v[8];
    for (int i = 0; i < 16; ++i) {
      w[i] = 0;
      for (int j = 0; j < 4; ++j) w[i] = w[i] << 8 | static_cast<uint8_t>(text[at + 4 * i + j]);
    }
    for (int i = 16; i < 64; ++i)
      w[i] = w[i - 16] + (turn(w[i - 15], 7) ^ turn(w[i - 15], 18) ^ w[i - 15] >> 3) + w[i - 7] +
             (turn(w[i - 2], 17) ^ turn(w[i - 2], 19) ^ w[i - 2] >> 10);
    std::copy(state, state + 8, v);
    for (int i = 0; i < 64; ++i) {
      uint32_t one = v[7] + (turn(v[4], 6) ^ turn(v[4], 11) ^ turn(v[4], 25)) + ((v[4] & v[5]) ^ (~v[4] & v[6])) + k[i] + w[i];
      uint32_t two = (turn(v[0], 2) ^ turn(v[0], 13) ^ turn(v[0], 22)) + ((v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]));
      std::copy_backward(v, v + 7, v + 8);
      v[4] += one;
      v[0] = one + two;
    }
    for (int i = 0; i < 8; ++i) state[i] += v[i];
  }
  Bytes digest;
  for (uint32_t word : state)
    for (int i = 3; i >= 0; --i) digest += static_cast<char>(word >> 8 * i);
  return digest;
}

Bytes hmac(Bytes key, const Bytes& text) {
  if (key.size() > 64) key = sha256(key);
  key.resize(64, '\0');
  Bytes inner = key, outer = key;
  for (char& c : inner) c ^= 0x36;
  for (char& c : outer) c ^= 0x5c;
  return sha256(outer + sha256(inner + text));
}

struct Head {
  char kind[4];
  uint16_t version, joints, feet, present;
  uint32_t zero;
  uint64_t number;
};
static_assert(sizeof(Head) == 24);

Bytes packed(const char* kind, int joints, uint64_t number, const Bytes& content, const Bytes& key) {
  Head head{{kind[0], kind[1], kind[2], kind[3]}, 3, static_cast<uint16_t>(joints), 0, 0, 0, number};
  Bytes packet = Bytes(reinterpret_cast<char*>(&head), sizeof head) + content;
  return packet + hmac(key, packet).substr(0, 16);
}

bool authentic(const Bytes& packet, const char* kind, int joints, size_t content, const Bytes& key) {
  if (packet.size() != 24 + content + 16 || packet.compare(0, 4, kind) != 0) return false;
  Head head;
  std::memcpy(&head, packet.data(), sizeof head);
  if (head.version != 3 || head.joints != joints) return false;
  Bytes tag = hmac(key, packet.substr(0, packet.size() - 16)).substr(0, 16);
  int different = 0;  // in constant time
  for (int i = 0; i < 16; ++i) different |= tag[i] ^ packet[packet.size() - 16 + i];
  return different == 0;
}

std::vector<double> measure(int joints, int tick) {  // time, gyro, accelerometer, angles, speeds, torques
  std::vector<double> values(7 + 3 * joints, 0.0);
  values[0] = 1e-3 * tick;
  values[6] = 9.81;
  return values;
}

void apply(int tick, const std::vector<double>& c) {  // torques, angles, speeds, kp, kd
  std::printf("%d %g\n", tick, c[0]);
}

int main(int argc, char** argv) {
  if (argc != 5) return std::fprintf(stderr, "robot_end PORT SECRET_FILE JOINTS TICKS\n"), 2;
  std::ifstream file(argv[2]);
  Bytes secret((std::istreambuf_iterator<char>(file)), {}), key, controller, own;
  while (!secret.empty() && std::isspace(static_cast<unsigned char>(secret.back()))) secret.pop_back();
  if (secret.size() < 16) return std::fprintf(stderr, "no secret of 16 bytes in %s\n", argv[2]), 2;
  int joints = std::atoi(argv[3]), ticks = std::atoi(argv[4]), tick = 0;
  int link = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in here{}, peer{};
  here.sin_family = AF_INET;
  here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  here.sin_port = htons(static_cast<uint16_t>(std::atoi(argv[1])));
  if (bind(link, reinterpret_cast<sockaddr*>(&here), sizeof here)) return std::perror("bind"), 2;
  int64_t newest = -1;
  auto post = [&](const Bytes& p) { sendto(link, p.data(), p.size(), 0, reinterpret_cast<sockaddr*>(&peer), sizeof peer); };
  auto tell = [&] {
    std::vector<double> m = measure(joints, tick);
    post(packed("LGMm", joints, tick, Bytes(reinterpret_cast<char*>(m.data()), 8 * m.size()), key));
  };
  while (tick < ticks) {
    pollfd ready{link, POLLIN, 0};
    if (poll(&ready, 1, 20) == 0) {  // no answer: the measurement, or its command, was lost
      if (!key.empty()) tell();
      continue;
    }
    char buffer[4096];
    sockaddr_in from{};
    socklen_t length = sizeof from;
    ssize_t size = recvfrom(link, buffer, sizeof buffer, 0, reinterpret_cast<sockaddr*>(&from), &length);
    Bytes packet(buffer, size > 0 ? size : 0);
    if (authentic(packet, "LGMh", joints, 16, secret) && newest < 0) {  // until the first command
      if (packet.substr(24, 16) != controller) {
        controller = packet.substr(24, 16);
        own.resize(16);
        if (getrandom(own.data(), 16, 0) != 16) return 2;
      }
      peer = from;
      key = hmac(secret, controller + own);
      post(packed("LGMw", joints, 0, controller + own, secret));
      tell();
    } else if (!key.empty() && authentic(packet, "LGMc", joints, 8 * (1 + 5 * joints), key)) {
      uint64_t number;
      std::memcpy(&number, packet.data() + 16, 8);
      std::vector<double> values(1 + 5 * joints);
      std::memcpy(values.data(), packet.data() + 24, 8 * values.size());
      if (static_cast<int64_t>(number) <= newest || values[0] != tick) continue;  // old, or of another measurement
      newest = static_cast<int64_t>(number);
      apply(tick, {values.begin() + 1, values.end()});
      if (++tick < ticks) tell();
    }
  }
}
