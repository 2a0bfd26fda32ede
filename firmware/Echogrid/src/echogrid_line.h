/* One line of the echogrid protocol, put together in memory: $KIND,SEQ,MS,value,...*CRC-32 CR LF.
 * Plain C without allocation; the same on a chip and on a computer. See docs/protocol.md.
 */
#ifndef ECHOGRID_LINE_H
#define ECHOGRID_LINE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ECHOGRID_PROTOCOL_VERSION 1
#define ECHOGRID_LINE_BYTES 96 /* the longest line, its end included */
#define ECHOGRID_NOTHING_SEEN (-1)
#define ECHOGRID_TOO_CLOSE (-2)

typedef struct {
    uint8_t length;
    char text[ECHOGRID_LINE_BYTES]; /* not ended by a zero */
} echogrid_line;

/* `ms` is when it was measured, not when it is sent. */
void echogrid_start(echogrid_line *line, const char *kind, uint16_t seq, uint32_t ms);
void echogrid_integer(echogrid_line *line, int32_t value);
/* A value of text. What the protocol forbids becomes `?`; what does not fit is cut off. */
void echogrid_word(echogrid_line *line, const char *text);
/* The checksum and the line's end: now `text` can be sent. */
void echogrid_end(echogrid_line *line);

#ifdef __cplusplus
}
#endif

#endif
