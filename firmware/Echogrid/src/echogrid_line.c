#include "echogrid_line.h"

#define END_BYTES 11 /* `*`, eight digits, CR and LF */

static void put(echogrid_line *line, char c)
{
    if (line->length < ECHOGRID_LINE_BYTES - END_BYTES)
        line->text[line->length++] = c;
}

static void put_unsigned(echogrid_line *line, uint32_t value)
{
    char digits[10];
    uint8_t count = 0;
    for (; value > 0xFFFF; value /= 10) /* slow on a small chip */
        digits[count++] = (char)('0' + value % 10);
    uint16_t rest = (uint16_t)value;
    do {
        digits[count++] = (char)('0' + rest % 10);
        rest = (uint16_t)(rest / 10);
    } while (rest != 0);
    while (count > 0)
        put(line, digits[--count]);
}

/* Half a byte at a time: four times as fast as bit by bit, with a table of 64 bytes. */
static uint32_t crc32(const char *text, uint8_t length)
{
    static const uint32_t of_nibble[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
        0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    uint32_t crc = 0xFFFFFFFF;
    for (uint8_t i = 0; i < length; i++) {
        crc ^= (uint8_t)text[i];
        crc = (crc >> 4) ^ of_nibble[crc & 15];
        crc = (crc >> 4) ^ of_nibble[crc & 15];
    }
    return ~crc;
}

void echogrid_start(echogrid_line *line, const char *kind, uint16_t seq, uint32_t ms)
{
    line->length = 0;
    put(line, '$');
    while (*kind != '\0')
        put(line, *kind++);
    put(line, ',');
    put_unsigned(line, seq);
    put(line, ',');
    put_unsigned(line, ms);
}

void echogrid_integer(echogrid_line *line, int32_t value)
{
    put(line, ',');
    if (value < 0)
        put(line, '-');
    put_unsigned(line, value < 0 ? 0u - (uint32_t)value : (uint32_t)value);
}

void echogrid_word(echogrid_line *line, const char *text)
{
    put(line, ',');
    for (; *text != '\0'; text++)
        put(line, *text < ' ' || *text > '~' || *text == '$' || *text == '*' ? '?' : *text);
}

void echogrid_end(echogrid_line *line)
{
    uint32_t crc = crc32(line->text + 1, (uint8_t)(line->length - 1));
    line->text[line->length++] = '*';
    for (int8_t shift = 28; shift >= 0; shift = (int8_t)(shift - 4))
        line->text[line->length++] = "0123456789ABCDEF"[crc >> shift & 15];
    line->text[line->length++] = '\r';
    line->text[line->length++] = '\n';
}
