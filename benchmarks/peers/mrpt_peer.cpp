// MRPT's occupancy grid on a session of ours: one timed insertion of all readings a line of input.
//
//   mrpt_peer SESSION
//
// SESSION holds little-endian float64: kind (0 ranger, 1 scan, 2 scan with widening beams),
// resolution_m, x_min, x_max, y_min, y_max, beam_width_rad, max_range_m, readings, beams; then a
// reading's x, y, heading and its ranges (NaN: none), reading after reading. A scan's beams are
// beam_width_rad apart. Each line read makes a fresh map and prints the thread's CPU seconds.

#include <mrpt/maps/COccupancyGridMap2D.h>
#include <mrpt/obs/CObservation2DRangeScan.h>
#include <mrpt/obs/CObservationRange.h>

#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>
#include <vector>

using mrpt::maps::COccupancyGridMap2D;
using mrpt::poses::CPose3D;

static double cpu_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  std::ifstream file(argv[1], std::ios::binary);
  double head[10];
  if (!file.read(reinterpret_cast<char*>(head), sizeof head)) return 2;
  const int kind = int(head[0]);
  const size_t readings = size_t(head[8]), beams = size_t(head[9]), stride = 3 + beams;
  std::vector<double> row(readings * stride);
  if (!file.read(reinterpret_cast<char*>(row.data()), row.size() * sizeof(double))) return 2;

  std::vector<CPose3D> poses(readings);
  std::vector<mrpt::obs::CObservationRange> echoes(kind == 0 ? readings : 0);
  std::vector<mrpt::obs::CObservation2DRangeScan> scans(kind == 0 ? 0 : readings);
  for (size_t i = 0; i < readings; ++i) {
    const double* r = &row[i * stride];
    poses[i] = CPose3D(r[0], r[1], 0.0, r[2], 0.0, 0.0);
    if (kind == 0) {
      echoes[i].sensorConeApperture = float(head[6]);
      echoes[i].maxSensorDistance = float(head[7]);
      mrpt::obs::CObservationRange::TMeasurement m;
      m.sensedDistance = float(r[3]);
      echoes[i].sensedData.push_back(m);
      continue;
    }
    scans[i].aperture = float(head[6] * double(beams - 1));
    scans[i].maxRange = float(head[7]);
    scans[i].rightToLeft = true;
    scans[i].resizeScan(beams);
    for (size_t k = 0; k < beams; ++k) {
      const bool valid = std::isfinite(r[3 + k]);
      scans[i].setScanRange(k, valid ? float(r[3 + k]) : 0.0f);
      scans[i].setScanRangeValidity(k, valid);
    }
  }

  std::string line;
  while (std::getline(std::cin, line)) {
    COccupancyGridMap2D map{float(head[2]), float(head[3]), float(head[4]), float(head[5]),
                            float(head[1])};
    map.insertionOptions.maxDistanceInsertion = float(head[7]);
    map.insertionOptions.considerInvalidRangesAsFreeSpace = false;
    map.insertionOptions.wideningBeamsWithDistance = kind == 2;
    map.fill(0.5f);
    const double start = cpu_seconds();
    for (size_t i = 0; i < readings; ++i)
      if (kind == 0)
        map.insertObservation(echoes[i], poses[i]);
      else
        map.insertObservation(scans[i], poses[i]);
    std::printf("%.9f\n", cpu_seconds() - start);
    std::fflush(stdout);
  }
  return 0;
}
